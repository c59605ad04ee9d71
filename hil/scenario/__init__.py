"""The scenario file as records: slave, master, link, sensors, fleet, modem; `presets/` holds those that are shipped.

Public: every module here: `config.load_scenario` and the records it returns, and `variant.write_variant`, which writes
a scenario with other values. It uses vehicles and worlds, and must not know who runs them.
"""
