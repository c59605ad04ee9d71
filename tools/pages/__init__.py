"""Make generated pages and pictures of the documentation."""
