"""`uuv-hil sim`: a mission or an autopilot's flight in one process."""
