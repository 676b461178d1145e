"""The names for arrays in annotations, by what they hold: numbers, complex numbers, truths, and places."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]
