"""A stable sort that allocates nothing: kernels sort a handful of numbers in every frame."""

from mdkf.compiled import kernel
from mdkf.tables import FloatArray, IntArray

RUN = 16
"""Numbers that are sorted by insertion before runs of them are merged."""


@kernel
def sort_by(key: FloatArray | IntArray, order: IntArray, n: int, spare: IntArray) -> None:
    """Sort the first n of `order` so that key[order] ascends; equal keys keep their order.

    spare (n..,) is overwritten. Keys are finite.
    """
    for begin in range(0, n, RUN):
        for i in range(begin + 1, min(begin + RUN, n)):
            entry = order[i]
            k = i
            while k > begin and key[order[k - 1]] > key[entry]:
                order[k] = order[k - 1]
                k -= 1
            order[k] = entry
    width = RUN
    while width < n:
        for begin in range(0, n - width, 2 * width):
            middle, end = begin + width, min(begin + 2 * width, n)
            left, right, k = begin, middle, begin
            while left < middle and right < end:
                if key[order[right]] < key[order[left]]:
                    spare[k] = order[right]
                    right += 1
                else:
                    spare[k] = order[left]
                    left += 1
                k += 1
            while left < middle:
                spare[k] = order[left]
                left += 1
                k += 1
            # What is left of the right run is in its place already.
            for i in range(begin, k):
                order[i] = spare[i]
        width *= 2
