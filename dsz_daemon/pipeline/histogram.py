"""A histogram of whole numbers that takes all of its room at once: what runs for weeks must not grow."""

from __future__ import annotations

from array import array


class Histogram:
    """Counts numbers rounded to `digits` digits, up to `decades` decades beyond; what is larger counts as the largest.

    >>> seen = Histogram(digits=2, decades=2)
    >>> for number in (7, 99, 104, 106, 7, 12_345, 999_999):
    ...     seen.add(number)
    >>> seen.items()
    [(7, 2), (99, 1), (100, 1), (110, 1), (10000, 2)]
    >>> seen.total, seen.median()
    (7, 100)
    """

    def __init__(self, digits: int = 3, decades: int = 5) -> None:
        self._digits, self._exact = digits, 10**digits
        self._decade = 9 * self._exact // 10
        self.total = 0
        self._counts = array("Q", bytes(8 * (self._exact + decades * self._decade + 1)))

    def add(self, number: int) -> None:
        """One more; `number` is not negative."""
        self.total += 1
        place = number
        if number >= self._exact:
            beyond = len(str(number)) - self._digits
            head = round(number / 10**beyond)
            place = min(beyond * self._decade + head, len(self._counts) - 1)
        self._counts[place] += 1

    def items(self) -> list[tuple[int, int]]:
        """(number, count) of all that came, smallest first."""
        return [(self._number(place), count) for place, count in enumerate(self._counts) if count]

    def median(self) -> int | None:
        """The number in the middle; None of nothing."""
        seen = 0
        for place, count in enumerate(self._counts):
            seen += count
            if count and seen >= self.total / 2.0:
                return self._number(place)
        return None

    def _number(self, place: int) -> int:
        if place < self._exact:
            return place
        beyond, head = divmod(place - self._exact, self._decade)
        number: int = (head + self._exact // 10) * 10 ** (beyond + 1)
        return number
