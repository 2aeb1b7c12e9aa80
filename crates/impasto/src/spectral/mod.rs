//! Reflectance from camera bands: estimators built in double precision, applied in single.
