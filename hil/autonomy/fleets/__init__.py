"""Formation control and target hunting of several vehicles."""
