#!/usr/bin/env bash
# What image-test.sh and cluster-test.sh share: tools, storage of their own, building, and starting what was built. No
# Docker engine is needed: buildah builds, and crun, an OCI runtime, runs. For root on a Debian system, whose packages
# it installs when they are missing. Sourced in the project's folder, with `packages` set to further packages by command.
# shellcheck disable=SC2034
python=$PWD/.venv/bin/python
kept=/var/cache/isoshape-image-test
work=$(mktemp -d)
state=$work/state
failed=1

say() { printf '%s\n' "$*"; }
pass() { printf '%4d s  ok    %s\n' "$SECONDS" "$*"; }
fail() {
    printf '%4d s  FAIL  %s\n' "$SECONDS" "$*" >&2
    exit 1
}

[[ $(id -u) == 0 ]] || fail 'the image is built and run without an engine, and only root can do that: run it as root'
command -v apt-get >/dev/null || fail 'this test installs its tools with apt-get, and there is none: run it on Debian'
[[ -x $python ]] || fail 'there is no environment: run this by make image-test'

missing=()
for tool in buildah crun debootstrap curl "${!packages[@]}"; do
    command -v "$tool" >/dev/null || missing+=("${packages[$tool]:-$tool}")
done
if ((${#missing[@]})); then
    say "installing ${missing[*]}"
    export DEBIAN_FRONTEND=noninteractive
    # Other steps may install packages at the same time.
    flock /tmp/isoshape-apt apt-get update -qq </dev/null >/dev/null
    flock /tmp/isoshape-apt apt-get install -qq --yes --no-install-recommends "${missing[@]}" </dev/null >/dev/null
fi

# Storage and a build of their own, so that no image or container of this machine's is touched.
mkdir -p "$kept"
exec 9>"$kept/lock"
flock 9
unset ISOSHAPE_API_KEY ISOSHAPE_API_KEYS ISOSHAPE_READ_KEYS
export BUILDAH_ISOLATION=chroot
export BUILDAH="buildah --root $kept/storage --runroot $work/run"
certificates=/etc/ssl/certs/ca-certificates.crt

# The runtime is asked to leave control groups alone, and given a file system without them, since it refuses machines
# that mount both versions.
runtime() {
    # shellcheck disable=SC2016
    unshare --mount --propagation private bash -c \
        'mount -t tmpfs none /sys/fs/cgroup && exec crun --root "$0" --cgroup-manager=disabled "$@"' "$state" "$@"
}

# build TAG ARGUMENT...: the image of the Dockerfile by that name; $base is then what it is made from.
build() {
    local tag=$1 lent=()
    shift
    base=$(sed -n 's/^ARG BASE=//p' docker/Dockerfile)
    docker/test/base_image.sh "$base"
    # A machine behind a proxy of its own trusts that proxy's certificate: lend the build this machine's, and keep none.
    if [[ -e $certificates ]]; then lent=(--volume "$certificates:$certificates:ro"); fi
    $BUILDAH bud --pull-never --format docker "${lent[@]}" "$@" --file docker/Dockerfile --tag "$tag" . \
        </dev/null >"$work/build" 2>&1 || {
        tail -n 40 "$work/build" >&2
        fail 'the image does not build'
    }
}
