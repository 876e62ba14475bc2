"""Tables into pictures, one call each: from above, errors over time, weights over time.

`plot` chooses by what it is given. Every function returns a figure, which a notebook shows and
`savefig` writes to a file; nothing is drawn by `pyplot`, so nothing needs closing.
"""

from experiments.plots.above import birds_eye
from experiments.plots.choose import plot
from experiments.plots.over_time import error_over_time, weights_over_time
from experiments.plots.picture import Picture

__all__ = ["Picture", "birds_eye", "error_over_time", "plot", "weights_over_time"]
