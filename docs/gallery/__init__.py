"""The pictures of the page gallery.md: a simulated painting, and a real icon."""
