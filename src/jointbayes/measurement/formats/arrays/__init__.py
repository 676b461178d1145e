"""Files of arrays: npz, HDF5, MATLAB."""
