# What the extension of BlueOS runs: the slave of /data/scenario.toml, and its live view. The container ends with the slave.
set -e
[ -e scenario.toml ] || cp /opt/uuv-hil/blueos.toml scenario.toml
uuv-hil view --scenario scenario.toml --connect tcp/127.0.0.1:7457 --listen 0.0.0.0:7480 --no-browser &
exec uuv-hil slave scenario.toml
