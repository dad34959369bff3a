"""Checks of the notebooks' exercises, one module a chapter. They say what is wrong and give a hint.

    from vo_lib.exercises import ch02
    ch02.epipolar_rows(my_rows)      # as the last line of a cell: shows the verdict

A check takes the student's number, array or function. It is a function with `@exercise`, which raises `Wrong`
(or calls a helper of `verdict` that does) and returns what to say when all is right.
"""

from .verdict import Verdict, Wrong, exercise

__all__ = ["Verdict", "Wrong", "exercise"]
