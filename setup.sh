#!/usr/bin/env bash
# Brings a bare Debian with Python 3.11 to the state in which `physavatar` runs: system libraries, virtual environment, packages.
# Usage: setup.sh VENV. Called by `make setup`, which skips it while pyproject.toml, constraints.txt and this file are unchanged.
set -euo pipefail
venv=$1

system_packages() {   # what is missing, by Debian name
    ldconfig -p | grep -qE 'libLLVM[-.](so\.)?1[6-9]|libLLVM[-.](so\.)?2[0-9]' || echo libllvm19
    [ -e /usr/include/suitesparse/cholmod.h ] || echo libsuitesparse-dev
    # CHOLMOD's supernodes run on whatever libblas.so.3 is: the reference BLAS factorises a garment 2.7 times slower
    ldconfig -p | grep -q libopenblas || echo libopenblas0-serial
    command -v gcc >/dev/null || echo gcc
    [ -e "$(python3.11 -c 'import sysconfig; print(sysconfig.get_path("include"))' 2>/dev/null)/Python.h" ] || echo python3.11-dev
    python3.11 -c 'import ensurepip, venv' 2>/dev/null || echo python3.11-venv
}

missing=$(system_packages | xargs)
if [ -n "$missing" ]; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >/dev/null
    else
        echo "physavatar: please install these system packages first: sudo apt-get install $missing" >&2
        exit 2
    fi
fi

[ -x "$venv/bin/python" ] || python3.11 -m venv "$venv"
pip() { "$venv/bin/python" -m pip --disable-pip-version-check --quiet "$@"; }
pip install -c constraints.txt wheel setuptools cython "numpy>=2.4"
# torch first and alone: only pip with an exact version takes the CPU build; a range pulls gigabytes of CUDA
pip install -c constraints.txt torch==2.13.0
# scikit-sparse has no wheel; it is compiled here against the system's CHOLMOD, in this environment
"$venv/bin/python" -c 'import sksparse.cholmod' 2>/dev/null || pip install --no-build-isolation -c constraints.txt scikit-sparse==0.4.16
pip install -c constraints.txt -e '.[demo,dev]'
pip install -c constraints.txt --no-deps rtmlib==0.0.16
"$venv/bin/python" -m compileall -q flows tasks storage_schemas || true
"$venv/bin/python" -m tasks.compiled_kernels   # a minute and a half of one core, which the first run would spend otherwise
