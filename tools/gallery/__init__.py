"""The pictures of docs/sensors.md, by kind of sensor. `tools/sensor_gallery.py` draws them."""
