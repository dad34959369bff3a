"""Exercises of the notebooks, a table a chapter. A check says what is wrong with an answer, with a hint.

    from vo_lib.course.exercises import ch02
    ch02.epipolar_rows(my_rows)      # as the last line of a cell: shows the verdict

A check takes the student's number, array or function. Each is an `Exercise` of `checker.py`: the right
answer, cases to run it on, and known mistakes, whose sentence and hint stand in `words.json`.
"""

from .checker import Exercise, Verdict

__all__ = ["Exercise", "Verdict"]
