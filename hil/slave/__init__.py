"""The daemon on the card computer: it stands in for the vehicle."""
