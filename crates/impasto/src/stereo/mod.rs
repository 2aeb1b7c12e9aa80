//! Photometric stereo: normals and albedo from samples under known lights.
