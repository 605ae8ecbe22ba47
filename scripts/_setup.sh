# Sourced by scripts/demo, scripts/test and scripts/docs: `set_up` or `set_up test` makes .venv ready and sets $root and
# $venv. pip takes no file whose SHA-256 is not in scripts/locks/.
#
# .venv/.irbcal-stamp holds a fingerprint of what was installed and is written last; .venv/.irbcal-unfinished is there
# from before the first step until then. So an interrupted set-up is seen, and starts again from nothing.

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv

fail() {
    printf '%s\n' "$1" >&2
    exit 1
}

# Prints the path of the interpreter behind $1 (behind a virtual environment, if it is in one); fails if it will not do.
suitable() {
    "$1" -I -c '
import sys
if sys.version_info < (3, 10):
    sys.exit(1)
import ensurepip, venv
print(getattr(sys, "_base_executable", sys.executable))' 2>/dev/null
}

choose_python() {
    local candidate
    if [[ -n ${PYTHON:-} ]]; then
        suitable "$PYTHON" || fail "PYTHON=$PYTHON is not a Python 3.10 or newer with the modules venv and ensurepip."
        return
    fi
    for candidate in python3 python3.13 python3.12 python3.11 python3.10; do
        if suitable "$candidate"; then return; fi
    done
    fail "irbcal needs Python 3.10 or newer with the modules venv and ensurepip (Debian: python3-venv); set PYTHON to one."
}

# Empties .venv, if it is ours, with the mark of the unfinished there from first to last.
make_room() {
    if [[ -e $venv && ! -e $venv/.irbcal-unfinished && ! -e $venv/.irbcal-root ]] && ! rmdir -- "$venv" 2>/dev/null; then
        fail "$venv was not made by irbcal's scripts: move it away, or run irbcal and pytest in it yourself."
    fi
    mkdir -p -- "$venv"
    touch -- "$venv/.irbcal-unfinished"
    find "$venv" -mindepth 1 ! -name .irbcal-unfinished -delete
}

version_of() {
    "$1" -I -c 'import sys; print(sys.version)'
}

# Fingerprint of the project's place, its requirements, its kernel, the interpreter and the extras $1.
fingerprint() {
    "$venv/bin/python" -I -c '
import hashlib, pathlib, sys
root, extras = pathlib.Path(sys.argv[1]), sys.argv[2]
digest = hashlib.sha256(repr((str(root), sys.version, extras)).encode())
kernel = ("hatch_build.py", "irbcal/kernel/kernel.hpp", "irbcal/kernel/binding.cpp")
for name in ("pyproject.toml", "scripts/locks/" + (extras or "demo") + ".txt", *kernel):
    digest.update(hashlib.sha256((root / name).read_bytes()).digest())
print(digest.hexdigest())' "$root" "$1"
}

# Is .venv whole, in its own place, and of the wanted interpreter?
venv_is_sound() {
    [[ ! -e $venv/.irbcal-unfinished && -f $venv/.irbcal-root && $(<"$venv/.irbcal-root") == "$root" ]] &&
        [[ $("$venv/bin/python" -I -c 'import pip, sys; print(sys.version)' 2>/dev/null) == "$1" ]]
}

up_to_date() {
    local stamp
    [[ -f $venv/.irbcal-stamp && ! -e $venv/.irbcal-unfinished && -x $venv/bin/python ]] || return 1
    stamp=$(<"$venv/.irbcal-stamp")
    # What the tests need includes what the demo needs.
    [[ $stamp == "$(fingerprint test)" || $stamp == "$(fingerprint "$1")" ]] || return 1
    [[ -z ${PYTHON:-} || $(version_of "$PYTHON") == "$(version_of "$venv/bin/python")" ]]
}

pip_install() {
    "$venv/bin/python" -I -m pip install -qq --no-input --disable-pip-version-check "$@" ||
        fail "The set-up of irbcal failed in pip (see above); the next run starts it again."
}

install() {
    local python
    if up_to_date "$1"; then return; fi
    python=$(choose_python)
    echo "Setting up irbcal in $venv with pip; this happens once and takes about a minute ..." >&2
    if ! venv_is_sound "$(version_of "$python")"; then
        make_room
        "$python" -I -m venv "$venv" || fail "$python could not make the virtual environment $venv."
        printf '%s\n' "$root" >"$venv/.irbcal-root"
    fi
    touch -- "$venv/.irbcal-unfinished"
    rm -f -- "$venv/.irbcal-stamp"
    # The build backend is among them; pip would take the newest one otherwise.
    pip_install --require-hashes -r "$root/scripts/locks/${1:-demo}.txt"
    pip_install --no-deps --no-build-isolation -e "$root"
    fingerprint "$1" >"$venv/.irbcal-stamp"
    rm -f -- "$venv/.irbcal-unfinished"
}

set_up() {
    local lock
    # Two runs at a time take turns, where flock exists; the folder itself is the lock.
    if command -v flock >/dev/null; then
        exec {lock}<"$root"
        flock "$lock"
        install "${1:-}"
        exec {lock}<&-
    else
        install "${1:-}"
    fi
}
