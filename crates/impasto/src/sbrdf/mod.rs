//! The fitting passes: from samples and normals to reflection parameters.
