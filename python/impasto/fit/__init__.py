"""From a stack to normals, reflectance and reflection models."""
