"""The pictures of docs/reference/sensors.md, by kind of sensor; `tools/pages/sensor_gallery.py` draws them."""
