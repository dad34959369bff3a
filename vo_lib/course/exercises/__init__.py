"""Exercises of the notebooks, a table a chapter. A check says what is wrong with an answer, with a hint.

    from vo_lib.course.exercises import ch02
    ch02.epipolar_rows(my_rows)      # as the last line of a cell: shows the verdict

A check takes the student's number, array or function. Each is an `Exercise` of `checker.py`: the right
answer and cases to run it on; its task, its praise and the known mistakes with their hints, as data, in
`words.json`.
"""

from .checker import Exercise
from .results import Verdict

__all__ = ["Exercise", "Verdict"]
