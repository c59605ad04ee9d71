"""Cameras and imaging sonars, and the appearance of surfaces in their images.

Public: the sensors' classes, which `sim.sensors.sensor_set` names, `range_image`, `samples`, `scanning_sonar`, and
`fan_picture.render_fan`. It must not encode or send images, and is imported only for a vehicle that carries such a
sensor.
"""
