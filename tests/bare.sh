#!/bin/bash
# Tests a newcomer's first hour: `./run study` and `./run test` in a clone of this tree's commit, on a minimal Debian 12 that has git
# but no compiler, make, nvcc or graphics card.
#
# Usage: bare.sh [brief]. `brief` leaves out the default study, the tests that the package contains and those that sanitizers run.
# These take longest, and run in two or more other stages of `./run test all`.
#
# Exit code: 0 both did what README says; 1 one of them did not; 77 the test cannot run here, and the last line says why.
#
# debootstrap makes the Debian from the package sources of this machine's apt-get. It is kept as build/bare/debian.tar, and the
# packages that `run` installs in it are kept in build/bare/archives. It is unpacked in a temporary folder and runs in private
# namespaces, where /dev is a file system with six devices, so that nothing inside can reach a device of this machine. Compilations
# come from the cache of this machine's other stages. A newcomer has all of this except that cache.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
kept=$root/build/bare
home=/root/voxspring

# Prints why the test cannot run here, and exits: neither success nor failure.
cannot() {
    echo "$1"
    exit 77
}

# Prints lines "deb URI SUITE COMPONENT" for this release of Debian, with the sources that this machine uses.
sources() {
    local codename
    # shellcheck source=/dev/null  # a file of the system
    codename=$(. /etc/os-release && echo "${VERSION_CODENAME:-}")
    # shellcheck disable=SC2016  # the format is apt-get's own
    apt-get indextargets --format 'deb $(REPO_URI) $(CODENAME) $(COMPONENT)' 'Created-By: Packages' 'Origin: Debian' |
        awk -v codename="$codename" '$3 == codename || index($3, codename "-") == 1' | sort -u
}

# --- In the namespaces --------------------------------------------------------------------------------
# Mounts the file systems that a Debian in the folder $1 needs.
mount_all() {
    local system=$1 device
    mount --bind "$system" "$system"
    mount -t proc proc "$system/proc"
    mount -t sysfs -o ro sysfs "$system/sys"
    mount -t tmpfs -o mode=755,nosuid tmpfs "$system/dev"
    for device in null:1:3 zero:1:5 full:1:7 random:1:8 urandom:1:9 tty:5:0; do
        IFS=: read -r name major minor <<<"$device"
        mknod -m 666 "$system/dev/$name" c "$major" "$minor"
    done
    mkdir "$system/dev/pts" "$system/dev/shm"
    mount -t devpts -o newinstance,ptmxmode=666 devpts "$system/dev/pts"
    mount -t tmpfs -o mode=1777 tmpfs "$system/dev/shm"
    ln -s pts/ptmx "$system/dev/ptmx"
    ln -s /proc/self/fd "$system/dev/fd"
    mount -t tmpfs -o mode=1777 tmpfs "$system/tmp"
    mkdir -p "$kept/archives/partial" "$system/ccache"
    mount --bind "$kept/archives" "$system/var/cache/apt/archives"
    mount --bind "$CCACHE_DIR" "$system/ccache"
}

# Runs a command and prints how long it took.
timed() {
    local TIMEFORMAT="bare: took %R s, in which the processors worked for %U s and the kernel for %S s"
    time "$@"
}

# Runs a command in the new Debian, with these environment variables only. Its builds let warnings pass, so their compilations must not
# enter the cache.
newcomer() {
    local proxy keep=()
    for proxy in http_proxy https_proxy no_proxy; do
        [ -z "${!proxy:-}" ] || keep+=("$proxy=${!proxy}")
    done
    chroot "$system" /usr/bin/env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin "${keep[@]}" CCACHE_DIR=/ccache \
        CCACHE_BASEDIR="$home" CCACHE_IGNOREOPTIONS=-Werror CCACHE_COMPILERCHECK=content \
        CCACHE_READONLY=1 CMAKE_CXX_COMPILER_LAUNCHER=ccache "$@"
}

# expect_row RESULT SCENE BACKEND: checks that a study's result has a row of that backend on that scene.
expect_row() {
    grep -q "\"name\": \"$2/$3/" "$1" || { echo "bare: $1 has no row of $3 on $2"; return 1; }
}

try_both() {
    local system=$1 how=$2 backend studies=(smoke default) leave_out=long
    if [ "$how" = brief ]; then studies=(smoke) leave_out='long|packaged|sanitized|threads'; fi
    mount_all "$system"
    newcomer apt-get -q update --error-on=any >"$kept/log" 2>&1 || cannot "there is no network: $(grep '^E:' "$kept/log" | head -n 1)"
    for study in "${studies[@]}"; do
        echo "bare: ./run study $study"
        timed newcomer "$home/run" study "$study" --out "$home/$study.json"
        for backend in cpu_reference cpu_parallel gl_fragment_implicit gl_compute_implicit vulkan_implicit; do
            expect_row "$system$home/$study.json" box@8 $backend
        done
    done
    echo "bare: ./run test"
    timed newcomer VOXSPRING_LEAVE_OUT="$leave_out" "$home/run" test
}

if [ "${1:-}" = --in-namespaces ]; then
    try_both "$2" "$3"
    exit
fi

# --- Outside of them ----------------------------------------------------------------------------------
[ "$(id -u)" = 0 ] || cannot "making a Debian takes root"
for tool in debootstrap unshare apt-get; do
    command -v $tool >/dev/null || cannot "there is no $tool"
done
unshare --mount --pid --fork true 2>/dev/null || cannot "this root may make no namespaces (docker: --privileged)"
mapfile -t listed < <(sources)
[ ${#listed[@]} -gt 0 ] || cannot "apt-get knows no Debian to install from: apt-get update?"

mkdir -p "$kept"
# Without ccache this folder stays empty, and everything is compiled.
export CCACHE_DIR=${CCACHE_DIR:-$(ccache --get-config cache_dir 2>/dev/null || echo "$kept/ccache")}
mkdir -p "$CCACHE_DIR"
system=$(mktemp -d "$kept/system-XXXXXX")
# Outside of the namespaces nothing of this machine is mounted in it.
trap 'rm -rf --one-file-system "$system"' EXIT
if [ ! -e "$kept/debian.tar" ]; then
    echo "bare: making a minimal Debian"
    read -r _ uri suite _ <<<"$(printf '%s\n' "${listed[@]}" | awk '$3 !~ /-/' | head -n 1)"
    # ccache is installed only for speed.
    if ! unshare --mount debootstrap --variant=minbase --include=git,ca-certificates,ccache "$suite" "$system" "$uri" >"$kept/log" 2>&1; then
        cannot "debootstrap made no Debian from $uri: $(tail -n 1 "$kept/log")"
    fi
    chroot "$system" apt-get clean
    tar --create --one-file-system --file "$kept/debian.tar.part" --directory "$system" --exclude=./dev/* .
    mv "$kept/debian.tar.part" "$kept/debian.tar"
else
    tar --extract --file "$kept/debian.tar" --directory "$system"
fi
printf '%s\n' "${listed[@]}" >"$system/etc/apt/sources.list"
# This Debian is thrown away, so that its files need not reach the disk.
echo force-unsafe-io >"$system/etc/dpkg/dpkg.cfg.d/thrown-away"
apt-config dump | grep -iE '^Acquire::(https?|Check-Valid-Until|Retries)\b' >"$system/etc/apt/apt.conf.d/99-of-the-machine" || true
cp /etc/resolv.conf "$system/etc/resolv.conf"
echo "127.0.0.1 localhost $(hostname)" >"$system/etc/hosts"
git -c safe.directory='*' clone --quiet --no-local "$root" "$system$home"
git -c safe.directory='*' -C "$root" diff --quiet HEAD || echo "bare: of the commit, without what is not committed"
unshare --mount --pid --fork --kill-child "${BASH_SOURCE[0]}" --in-namespaces "$system" "${1:-whole}"
