//! Levenberg-Marquardt for small problems; knows nothing of light.
