//! Normals to height.
