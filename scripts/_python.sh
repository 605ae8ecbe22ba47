# Sourced by scripts/app, scripts/demo, scripts/test and scripts/docs: runs their Python twin with a Python that will do, or says so.
here=$(dirname -- "${BASH_SOURCE[0]}")

run_twin() {
    local name=$1 candidate
    shift
    for candidate in ${PYTHON:+"$PYTHON"} python3 python3.13 python3.12 python3.11 python3.10; do
        if "$candidate" -I -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
            exec "$candidate" "$here/$name.py" "$@"
        fi
        if [[ -n ${PYTHON:-} ]]; then
            echo "PYTHON=$PYTHON is not a Python 3.10 or newer with the modules venv and ensurepip." >&2
            exit 1
        fi
    done
    echo "irbcal needs Python 3.10 or newer with the modules venv and ensurepip (Debian: python3-venv); set PYTHON to one." >&2
    exit 1
}
