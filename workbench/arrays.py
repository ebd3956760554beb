"""Arrays as annotations name them: shapes stand where they are used."""

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Complex = npt.NDArray[np.complex128]
