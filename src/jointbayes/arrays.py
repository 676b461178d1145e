"""The one name for arrays of floating-point numbers in annotations."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
