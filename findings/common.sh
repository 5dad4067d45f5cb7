# Sourced by each finding: a temporary folder, which is the current one, and is removed at the end. Pinned packages are
# installed into it. A finding that could not install them ends with 3: nothing was measured.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

# Install packages for python: name==version ...
install() {
    [ -d "$folder/venv" ] || python3 -m venv "$folder/venv"
    "$folder/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile "$@" > install.log 2>&1 ||
        not_installed "$*"
}

# Install packages for node: name@version ...
install_npm() {
    npm install --silent --no-audit --no-fund "$@" > install.log 2>&1 || not_installed "$*"
}

not_installed() {
    tail -n 3 install.log
    echo "not installed: $1"
    exit 3
}

# A wheel whose system library is missing here says nothing about the finding.
python() {
    code=0
    "$folder/venv/bin/python" "$@" 2> errors.log || code=$?
    cat errors.log >&2
    if [ $code != 0 ] && grep -q 'cannot open shared object file' errors.log; then
        echo "not measured: a system library is missing"
        exit 3
    fi
    return $code
}
