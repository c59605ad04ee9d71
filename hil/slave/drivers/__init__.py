"""STM32 drivers as the slave sees them: in its own process, or at the far end of a link."""
