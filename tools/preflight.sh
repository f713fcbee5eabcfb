#!/bin/sh
# Says what this machine lacks, all at once, then makes the virtual environment.
# Arguments: the Python interpreter to use (may be empty), the folder of the environment.
set -u
wanted=$1
venv=$2
lacking=""
lack() { lacking="$lacking
  - $1"; }

recent='import sys; sys.exit(sys.version_info < (3, 11))'
python=""
for candidate in ${wanted:-python3 python3.14 python3.13 python3.12 python3.11 python}; do
    if "$candidate" -c "$recent" 2>/dev/null; then
        python=$candidate
        break
    fi
done
if [ -z "$python" ]; then
    found=$("${wanted:-python3}" --version 2>&1) || found="none"
    lack "Python 3.11 or later (found: $found); choose one with \`make PYTHON=...\`"
elif ! "$python" -c 'import venv, ensurepip' 2>/dev/null; then
    lack "the venv module of $python (Debian, Ubuntu: package python3-venv)"
fi

if ! command -v cargo >/dev/null 2>&1; then
    lack "cargo, the Rust build tool, 1.88 or later (https://rustup.rs)"
else
    minor=$(cargo --version 2>/dev/null | sed -n 's/^cargo 1\.\([0-9]*\)\..*/\1/p')
    if [ -n "$minor" ] && [ "$minor" -lt 88 ]; then
        lack "cargo 1.88 or later (found: $(cargo --version)); \`rustup update\` brings it"
    fi
fi

if ! command -v cc >/dev/null 2>&1; then
    lack "a C linker named cc (Debian, Ubuntu: package gcc)"
fi

if [ -n "$lacking" ]; then
    echo "Holonom cannot be set up; this machine lacks:$lacking" >&2
    exit 1
fi

# An environment whose interpreter is gone or too old is made anew.
if ! "$venv/bin/python" -c "$recent" 2>/dev/null || ! "$venv/bin/pip" --version >/dev/null 2>&1; then
    echo "setting up: $venv with $("$python" --version)"
    rm -rf "$venv"
    "$python" -m venv "$venv" || exit 1
fi
