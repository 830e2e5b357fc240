#!/bin/sh
# Prints the path of a Python that Blender is published for and that really runs: 3.13, else 3.11.
# Usage: find_python.sh [3.13|3.11]. With PYTHON set, that one or nothing. Otherwise it looks along PATH,
# then in the folders of pyenv, asdf, mise and uv. Every candidate is executed: a version manager's shim can
# exist and fail. What is missing is said in one line on standard error (exit 1). Shell builtins only.

# A candidate answers "VERSION PATH"; "novenv" where Debian split venv off; "no" where wheels would not fit.
probe='
import sys, sysconfig
if sys.implementation.name != "cpython" or sysconfig.get_config_var("Py_GIL_DISABLED"):
    sys.exit("no")
import ctypes, ssl, zlib
try:
    import ensurepip, venv
    path = getattr(sys, "_base_executable", None) or sys.executable
except ImportError:
    path = "novenv"
print("%d.%d" % sys.version_info[:2], path)
'

seen=""    # other versions that run, for the last message
novenv=""  # versions that run but have no venv

# try FILE VERSIONS: prints the interpreter's path and ends the script if FILE is one of VERSIONS.
try() {
    answer=$("$1" -c "$probe" 2>/dev/null) || return 0
    version=${answer%% *}
    path=${answer#* }
    case " $2 " in
        *" $version "*) ;;
        *) case " $seen " in *" $version "*) ;; *) seen="${seen:+$seen }$version" ;; esac; return 0 ;;
    esac
    if [ "$path" = novenv ]; then
        case " $novenv " in *" $version "*) ;; *) novenv="${novenv:+$novenv }$version" ;; esac
        return 0
    fi
    printf '%s\n' "$path"
    exit 0
}

# search VERSION: along PATH, then where version managers keep theirs.
search() {
    rest=$PATH:
    while [ -n "$rest" ]; do
        folder=${rest%%:*}
        rest=${rest#*:}
        for name in "python$1" python3 python; do
            [ -x "$folder/$name" ] && [ ! -d "$folder/$name" ] && try "$folder/$name" "$1"
        done
    done
    data=${XDG_DATA_HOME:-$HOME/.local/share}
    for file in \
        "${PYENV_ROOT:-$HOME/.pyenv}/versions/$1"*/bin/python \
        "${ASDF_DATA_DIR:-$HOME/.asdf}/installs/python/$1"*/bin/python \
        "${MISE_DATA_DIR:-$data/mise}/installs/python/$1"*/bin/python \
        "${UV_PYTHON_INSTALL_DIR:-$data/uv/python}/cpython-$1"*/bin/python3
    do
        [ -x "$file" ] && try "$file" "$1"
    done
}

HOME=${HOME:-/}
wanted=${1:-3.13 3.11}
if [ -n "${PYTHON:-}" ]; then
    try "$PYTHON" "$wanted"
else
    for version in $wanted; do search "$version"; done
fi

choices=${1:-3.13 or 3.11}
runs=${seen:+"is Python $seen"}
runs=${runs:-does not run}
if [ -n "$novenv" ]; then
    package=python${novenv%% *}-venv
    echo "Python ${novenv%% *} is here but cannot make virtual environments: apt install $package" >&2
elif [ -n "${PYTHON:-}" ]; then
    echo "PYTHON=$PYTHON $runs: it must be a Python $choices." >&2
else
    echo "No Python $choices that runs was found${seen:+ (only $seen, which Blender is not published for)}." \
        "Install one: apt install python3 python3-venv (Debian 12, 13), dnf install python3.13," \
        "brew install python@3.13 or uv python install 3.13." >&2
fi
exit 1
