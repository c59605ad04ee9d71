"""UDP, TCP, serial and zenoh endpoints, and the partners at their other ends."""
