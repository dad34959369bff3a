"""Which sequence a panel shows, and which one it opens."""

from __future__ import annotations

import threading


class Opening:
    """The choices of a panel's sequences, each with a number.

    To open a sequence may take seconds, in which the person chooses another one. So only the result of the
    last choice counts; that of an earlier choice, a sequence or an error, comes too late and is dropped. A
    choice that fails or is stopped leaves the sequence that is shown.

    The panel calls the methods while it holds its redraws back: then no choice comes between the question
    whether a result is wanted and its use.

    Attributes
    ----------
    shown : name of the sequence that is shown, as in the panel's list; None before the first one.
    wanted : name of the last choice; `shown` when nothing is being opened.
    starts : lock for the start of a job, so that a later choice is started later.
    """

    def __init__(self) -> None:
        self.shown: str | None = None
        self.wanted: str | None = None
        self.starts = threading.Lock()
        self._last = 0  # number of the last choice

    @property
    def pending(self) -> bool:
        """Whether a sequence is being opened."""
        return self.wanted != self.shown

    def choose(self, name: str) -> int:
        """Want a sequence in place of all chosen before; returns the number of the choice."""
        self.wanted = name
        self._last += 1
        return self._last

    def is_wanted(self, choice: int) -> bool:
        """Whether the result of a choice still counts."""
        return choice == self._last and self.pending

    def succeed(self) -> None:
        """The wanted sequence is shown."""
        self.shown = self.wanted

    def give_up(self) -> None:
        """The wanted sequence cannot be shown, or is no longer wanted."""
        self.wanted = self.shown
