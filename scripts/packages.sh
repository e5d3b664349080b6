# What the machine lacks for the work at hand, and how it comes: by apt-get on Debian and Ubuntu, as root or with sudo.
# Elsewhere, or with --no-install, one line names what to install and the smaller thing that works without it.
# shellcheck shell=bash

install=yes     # no: --no-install
must_have=no    # yes: nothing smaller will do
packages=()     # Debian's names of what is missing
purposes=()     # what each is for
smaller=()      # what is done without it

has() { command -v "$1" >/dev/null 2>&1; }

# lacks PACKAGES PURPOSE SMALLER: note what is missing.
lacks() {
    # shellcheck disable=SC2206  # names of packages, one a word
    packages+=($1)
    purposes+=("$1 ($2)")
    smaller+=("$3")
}

join() {
    local text=$1
    shift
    [ $# = 0 ] || text+=$(printf ', %s' "$@")
    printf '%s' "$text"
}

# A Python that is new enough, into $python: the one that PYTHON names, else the first on the path.
find_python() {
    local candidate
    python=
    too_old=
    while read -r candidate; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null </dev/null; then
            python=$candidate
            return 0
        fi
        too_old=${too_old:-$("$candidate" -c 'import platform; print(platform.python_version())' 2>/dev/null </dev/null)}
    done < <(if [ -n "${PYTHON:-}" ]; then echo "$PYTHON"; else type -ap python3 python3.13 python3.12 python3.11; fi)
    return 1
}

python_says() { "$python" -c "$1" >/dev/null 2>&1; }

has_headers() { python_says 'import os, sysconfig; os.stat(os.path.join(sysconfig.get_path("include"), "Python.h"))'; }

# The headers of the library too: clang++ is often there without any.
has_compiler() {
    local compiler program='#include <vector>' options=(-std=c++17 -x c++ -fsyntax-only -)
    if [ -n "${CXX:-}" ]; then
        # shellcheck disable=SC2086  # it may hold options, as for CMake
        $CXX "${options[@]}" 2>/dev/null <<<"$program"
        return
    fi
    for compiler in c++ g++ clang++; do
        "$compiler" "${options[@]}" 2>/dev/null <<<"$program" && return
    done
    return 1
}

has_node() { node -e 'process.exit(parseInt(process.versions.node) < 18 ? 1 : 0)' 2>/dev/null; }
has_npm() { has npm && has_node; }
has_chromium() { has chromium || has chromium-browser || has google-chrome; }

# What the parts named lack, into packages, purposes and smaller.
look_for() {
    local part
    packages=() purposes=() smaller=()
    for part in "$@"; do
        case $part in
            run | dev) look_for_python ;;
            page) has_npm || lacks "$(has_node || echo 'nodejs ')npm" "Node.js 18 or newer, for the page" "$(page_without_npm)" ;;
            browser)
                has_chromium || lacks "$(chromium_package)" "for the tests in a browser" "without the tests in a browser" ;;
            fenicsx)
                has_fenicsx || lacks "$fenicsx" "the paper's finite element engine" "without DOLFINx" ;;
            openigtlink)
                has_openigtlink || lacks "$openigtlink" "the C++ library of OpenIGTLink, for its tests" "without OpenIGTLink's C++ library" ;;
            postgresql) has_postgresql || lacks postgresql "a database server, for the lab's tests" "without PostgreSQL" ;;
        esac
    done
}

look_for_python() {
    local name
    if find_whole_environment || find_python; then
        name=python3
        case $python in */python3.*) name=${python##*/} ;; esac
        [ -n "$whole" ] || python_says 'import venv, ensurepip' ||
            lacks "$name-venv" "virtual environments of Python" "nothing"
        has_headers || lacks "$name-dev" "headers of Python, for the compiled core" "on the NumPy twin (the same results, slower)"
    elif [ -n "$too_old" ]; then
        fail "Python 3.11 or newer is needed, $too_old is here; Debian 12 and Ubuntu 24.04 have it, or name one: PYTHON=/path/to/python3.12"
    elif [ -n "${PYTHON:-}" ]; then
        fail "PYTHON = $PYTHON is no Python; name one of 3.11 or newer, or unset it"
    else
        lacks "python3 python3-venv python3-dev" "Python 3.11 or newer" "nothing"
    fi
    has_compiler || lacks g++ "a C++17 compiler, for the core" "on the NumPy twin (the same results, slower)"
}

page_without_npm() { if [ -f "$page/index.html" ]; then echo "with the page as it is"; else echo "without the page"; fi; }

# Ubuntu's own package fetches a snap.
chromium_package() {
    if grep -qx 'ID=ubuntu' /etc/os-release 2>/dev/null; then echo chromium-browser; else echo chromium; fi
}

# The second package makes its solver fast.
fenicsx="python3-dolfinx-real libopenblas0-pthread"
has_fenicsx() {
    /usr/bin/python3 -c 'import importlib.util, sys; sys.exit(importlib.util.find_spec("dolfinx") is None)' 2>/dev/null
}

openigtlink="libopenigtlink-dev openigtlink-examples"
has_openigtlink() { [ -d /usr/include/openigtlink ] && [ -d /usr/share/doc/openigtlink-examples/examples ]; }

has_postgresql() { compgen -G "/usr/lib/postgresql/*/bin/pg_ctl" >/dev/null; }

# provide PART...: install what they lack, or say what is done without.
provide() {
    look_for "$@"
    [ ${#packages[@]} -gt 0 ] || return 0
    if [ "$install" = yes ] && may_install; then
        say "installing by apt-get: $(join "${purposes[@]}")"
        nothing_works_without || remedy="; --no-install goes on without it"
        [ ${#as_root[@]} = 0 ] || sudo -v || fail "sudo refused$remedy"
        apt_install
        remedy=
        hash -r
        look_for "$@"
        [ ${#packages[@]} -gt 0 ] || return 0
    fi
    do_without
}

nothing_works_without() { case " ${smaller[*]} " in *" nothing "*) ;; *) return 1 ;; esac; }

do_without() {
    local missing how
    missing="missing: $(join "${purposes[@]}")"
    how="on Debian and Ubuntu, as root: apt-get install ${packages[*]}"
    ! nothing_works_without || fail "$missing; nothing works without; $how"
    [ "$must_have" = no ] || fail "$missing; all of it is needed here; $how"
    say "$missing; $how; going on $(printf '%s\n' "${smaller[@]}" | sort -u | paste -sd '|' - | sed 's/|/, /g')"
}

# Without a terminal nobody can type the password of sudo.
may_install() {
    as_root=()
    has apt-get || return 1
    [ "$(id -u)" != 0 ] || return 0
    as_root=(sudo)
    has sudo && { [ -t 0 ] || sudo -n true 2>/dev/null; }
}

# sudo drops the environment: what names a proxy goes along. apt-get reads the small letters only; pip and npm read both.
apt_environment() {
    local name large
    printf '%s\0' DEBIAN_FRONTEND=noninteractive
    for name in http_proxy https_proxy no_proxy; do
        large=$(printf '%s' "$name" | tr '[:lower:]' '[:upper:]')
        [ -z "${!name:-${!large:-}}" ] || printf '%s\0' "$name=${!name:-${!large}}"
    done
}

apt_install() {
    local entry environment=()
    while IFS= read -r -d '' entry; do environment+=("$entry"); done < <(apt_environment)
    rootly=(${as_root[@]+"${as_root[@]}"} env "${environment[@]}")
    quietly "apt-get install ${packages[*]}" update_and_install
}

update_and_install() {
    local get=("${rootly[@]}" apt-get -o DPkg::Lock::Timeout=600 install -y -q --no-install-recommends)
    "${rootly[@]}" apt-get update || true  # one source of many may be out of reach
    # What an interrupted installation left is finished first.
    if [ -n "$(dpkg --audit 2>&1)" ]; then
        "${rootly[@]}" dpkg --force-confold --configure -a || true  # the rest is still to be unpacked
        "${get[@]}" --fix-broken
    fi
    "${get[@]}" "${packages[@]}"
}
