#!/usr/bin/env bash
# Everything that ./run, ./test and make need, made once: .venv, the page, and the system's packages for them.
#   scripts/setup.sh [--no-install] PART...    parts: run, dev, page, browser, fenicsx, openigtlink,
#                                            postgresql, slicer, ros
# A part that is ready costs a moment. What an interrupted start left is mended by the next one; two at once take turns.

here=$(cd -P "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(dirname "$here")
log=$root/build/setup.log
page=src/sonospline/server/page
remedy=  # what to do if the step at hand fails

say() { printf '%s: %s\n' "${0##*/}" "$*" >&2; }
fail() {
    say "$*"
    exit 1
}

# shellcheck source=scripts/packages.sh
. "$here/packages.sh"

# set_up PART...: in the folder of the project.
set_up() {
    # shellcheck disable=SC2046  # names of parts, one a word
    set -- $(stale "$@")
    [ $# -gt 0 ] || return 0
    mkdir -p build || fail "the folder of the project cannot be written to"
    trap 'say "interrupted; the next start goes on"; exit 130' INT TERM
    lock
    # shellcheck disable=SC2046
    set -- $(stale "$@")
    use_own_caches_without_a_home
    provide "$@"
    local part
    for part in "$@"; do "make_$part"; done
    unlock
    trap - INT TERM
}

stale() {
    local part
    for part in "$@"; do "fresh_$part" || echo "$part"; done
}

# The lock ends with the processes that hold it, however they end.
lock() {
    has flock || return 0
    exec 9>build/setup.lock
    flock -n 9 && return
    say "another start is at work here; waiting for it"
    flock 9
}

unlock() { exec 9>&-; }

# quietly WHAT COMMAND...: its words go into the log; if it fails, one line says why.
quietly() {
    local what=$1
    shift
    "$@" >"$log" 2>&1 </dev/null || fail "$what failed: $(reason); all it said is in $log$remedy"
}

reason() {
    local words
    words=$(grep -v '^sudo:' "$log" || true)
    case $(grep -oiE "$out_of_reach|$not_trusted" <<<"$words" | tail -n 1) in
        '') { grep -iE '^E: |error|ERR!' <<<"$words" || echo "$words"; } | tail -n 1 ;;
        *[Cc][Ee][Rr][Tt]*) echo "a certificate is not trusted here (name its authority in PIP_CERT and NODE_EXTRA_CA_CERTS)" ;;
        *) echo "no network, or a proxy that is not named in http_proxy and https_proxy" ;;
    esac
}
out_of_reach='failure resolving|could not resolve|name or service not known|NameResolution|NewConnection|ENOTFOUND|EAI_AGAIN'
out_of_reach+='|ECONNREFUSED|network is unreachable|could not connect|unable to connect|timed out|connect to proxy'
not_trusted='certificate verify failed|SELF_SIGNED_CERT|UNABLE_TO_GET_ISSUER_CERT'

# npm ends where it cannot write to its cache, pip becomes slow.
use_own_caches_without_a_home() {
    [ ! -w "${HOME:-/nonexistent}" ] || return 0
    export npm_config_cache=${npm_config_cache:-$root/build/npm-cache} PIP_CACHE_DIR=${PIP_CACHE_DIR:-$root/build/pip-cache}
}

# --- the Python environment: run (the library with its extras) and dev (what tests it)

fingerprint_of_environment() {
    { echo "$root"; readlink -f .venv/bin/python; cat pyproject.toml constraints.txt CMakeLists.txt src/sonospline/_core/src/*/*; } | cksum
}

# Its stamp holds the fingerprint and which core came of it: core, twin (no compiler), or broken (in spite of one).
fresh_run() {
    [ -x .venv/bin/python ] || return 1
    case $(cat .venv/run.stamp 2>/dev/null) in
        "$(fingerprint_of_environment) twin") ! can_compile ;;
        "$(fingerprint_of_environment) "*) ;;
        *) return 1 ;;
    esac
}

fresh_dev() { fresh_run && cmp -s .venv/run.stamp .venv/dev.stamp; }

can_compile() { find_whole_environment && has_headers && has_compiler; }

# An environment with pip that was made in this very place, into $python.
find_whole_environment() {
    whole=
    python=.venv/bin/python
    grep -qsF "$root/.venv" .venv/pyvenv.cfg && python_says 'import pip' && whole=yes
}

make_run() {
    ! fresh_run || return 0
    rm -f .venv/run.stamp .venv/dev.stamp
    if ! find_whole_environment; then
        find_python
        say "making .venv with $("$python" -V)$([ ! -e .venv ] || echo ' (the one here is unfinished, or was made elsewhere)')"
        quietly "$python -m venv .venv" "$python" -m venv --clear .venv
    fi
    discard_half_installed
    say "installing the library and what it needs into .venv (some minutes the first time)"
    quietly "pip install pip" .venv/bin/python -m pip install -c constraints.txt pip
    pip --editable '.[all]'
    local built
    built=$(SONOSPLINE_BACKEND='' .venv/bin/python -P -c 'import sonospline._core as c; print("core" if c.native else "twin")')
    if [ "$built" = twin ] && has_headers && has_compiler; then built=broken; fi
    echo "$(fingerprint_of_environment) $built" >.venv/run.stamp
}

make_dev() {
    make_run
    ! fresh_dev || return 0
    say "installing what the tests need into .venv"
    discard_half_installed
    pip --group test --group lint --group docs
    cp .venv/run.stamp .venv/dev.stamp
}

# A compiler is here, and yet the core is not.
core_is_broken() { grep -qs 'broken$' .venv/run.stamp; }

pip() {
    PIP_USER=0 quietly "pip install $*" .venv/bin/python -m pip install --no-input --disable-pip-version-check \
        --constraint constraints.txt --build-constraint constraints.txt "$@"
}

# pip writes RECORD last: a package without one was interrupted, and pip would take it for installed.
discard_half_installed() {
    local packages info
    for packages in .venv/lib/python*/site-packages; do
        for info in "$packages"/*.dist-info; do [ -s "$info/RECORD" ] || rm -rf "$info"; done
        rm -rf "$packages"/~*
    done
}

# --- the page of the simulator

fingerprint_of_page() {
    { find web -maxdepth 1 -type f; find web/src -type f ! -name '*.gen.ts'; } |
        LC_ALL=C sort | tr '\n' '\0' | xargs -0 cat | cksum
}

# A page that came with the sources is good where nothing could build another.
fresh_page() {
    [ -f "$page/index.html" ] || return 1
    [ "$(fingerprint_of_page)" = "$(cat web/node_modules/.page 2>/dev/null)" ] || { [ ! -e web/node_modules ] && ! has_npm; }
}

make_page() {
    has_npm || return 0
    make_node_modules
    say "building the page"
    quietly "npm run build" npm --prefix web run build -- --logLevel warn --outDir ../build/page --emptyOutDir
    rm -rf "$page"
    mv build/page "$page"
    fingerprint_of_page >web/node_modules/.page
}

# Beside their place, then moved there: an interrupted installation is never taken for whole.
make_node_modules() {
    ! cmp -s web/package.json web/node_modules/.package.json || return 0
    say "installing what the page is built with into web/node_modules"
    rm -rf build/web
    mkdir build/web
    cp web/package.json web/.npmrc build/web
    quietly "npm install" npm --prefix build/web install --include dev --loglevel error
    cp web/package.json build/web/node_modules/.package.json
    rm -rf web/node_modules
    mv build/web/node_modules web/node_modules
    rm -rf build/web
}

# --- programs of others, for tests, each in an environment of its own in build/: 3D Slicer's core pins another VTK

fresh_slicer() { has_own slicer; }
make_slicer() { make_own slicer "3D Slicer's core" "1 GB"; }
fresh_ros() { has_own ros; }
make_ros() { make_own ros "rclpy of ROS 2" "400 MB"; }

# The pins are copied last: an interrupted installation is made anew.
has_own() { cmp -s "tests/oracles/$1.txt" "build/$1/pins"; }

# make_own NAME WHAT SIZE
make_own() {
    ! has_own "$1" || return 0
    say "installing $2 into build/$1 ($3, a minute or two)"
    find_whole_environment || find_python
    quietly "$python -m venv build/$1" "$python" -m venv --clear "build/$1"
    quietly "pip install -r tests/oracles/$1.txt" "build/$1/bin/python" -m pip install --no-input \
        --disable-pip-version-check --requirement "tests/oracles/$1.txt"
    cp "tests/oracles/$1.txt" "build/$1/pins"
}

# --- the system's programs

fresh_browser() { has_chromium; }
make_browser() { :; }
fresh_fenicsx() { has_fenicsx; }
make_fenicsx() { :; }
fresh_openigtlink() { has_openigtlink; }
make_openigtlink() { :; }
fresh_postgresql() { has_postgresql; }
make_postgresql() { :; }

if [ "${BASH_SOURCE[0]}" = "$0" ]; then
    set -euo pipefail
    cd "$root"
    if [ "${1:-}" = --no-install ]; then
        install=no
        shift
    fi
    set_up "$@"
fi
