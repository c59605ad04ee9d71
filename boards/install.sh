#!/bin/sh
# Install the slave, and what runs beside it, on this board as services that start with it. One command, on the board:
#
#     sudo sh install.sh uuv_hil-VERSION-...whl SCENARIO --user NAME [other options of `uuv-hil board install`]
#
# The first argument is what pip installs: a wheel, a folder, or a name with a version. It is installed into a virtual
# environment of its own. To update, run the command again with a newer version.
# To remove everything: sudo uuv-hil board uninstall && sudo rm -r /opt/uuv-hil-venv /usr/local/bin/uuv-hil
set -eu

folder=${UUV_HIL_FOLDER:-/opt/uuv-hil-venv}
if [ $# -lt 2 ]; then
  sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
package=$1 scenario=$2
shift 2
python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' ||
  { echo "install.sh: Python 3.10 or later is needed" >&2; exit 5; }
python3 -c 'import ensurepip, venv' 2>/dev/null ||
  { echo "install.sh: no virtual environments: apt install python3-venv" >&2; exit 5; }
test -x "$folder/bin/pip" || python3 -m venv "$folder"
"$folder/bin/pip" install --quiet --disable-pip-version-check --upgrade "$package"
"$folder/bin/python" -m compileall -q "$folder/lib" || true # some files of other packages may not compile
mkdir -p /usr/local/bin
ln -sf "$folder/bin/uuv-hil" /usr/local/bin/uuv-hil
"$folder/bin/uuv-hil" board install "$scenario" --yes "$@"
(cd /etc/systemd/system && systemctl restart uuv-hil*.service)
systemctl --no-pager --lines=0 status uuv-hil
