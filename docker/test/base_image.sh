#!/usr/bin/env bash
# Makes a local stand-in for the base image that the Dockerfile names, where no image registry is reached: the same
# Debian release from its packages, with that release's Python under the names that the real image has.
# Made once and kept in the storage of $BUILDAH; made anew when this file changes.
#   base_image.sh python:3.13-slim-trixie
set -euo pipefail

name=$1
[[ $name =~ ^python:([0-9]+\.[0-9]+)-slim-([a-z]+)$ ]] || { echo "no recipe for the base image $name" >&2; exit 1; }
version=${BASH_REMATCH[1]} release=${BASH_REMATCH[2]}
image=localhost/$name
recipe=$(sha256sum "$0" | cut -d ' ' -f 1)

if [[ $($BUILDAH inspect --type image --format '{{index .OCIv1.Config.Labels "recipe"}}' "$image" 2>/dev/null) == "$recipe" ]]
then
    echo "$image is there"
    exit
fi

container=$($BUILDAH from scratch)
trap '$BUILDAH rm "$container" >/dev/null' EXIT
root=$($BUILDAH mount "$container")

log=$(mktemp)
debootstrap --variant=minbase --include=ca-certificates,python3,python3-venv "$release" "$root" >"$log" 2>&1 || {
    tail -n 30 "$log" >&2
    exit 1
}
rm -rf "$log" "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/*
# debootstrap copies these two from the machine that it runs on.
: >"$root/etc/resolv.conf"
echo localhost >"$root/etc/hostname"
echo '127.0.0.1 localhost' >"$root/etc/hosts"
ln -s /usr/bin/python3 "$root/usr/local/bin/python3"
ln -s python3 "$root/usr/local/bin/python"

found=$(chroot "$root" python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
[[ $found == "$version" ]] || { echo "$release has Python $found, and $name asks for $version" >&2; exit 1; }

$BUILDAH config --label "recipe=$recipe" --cmd python3 \
    --env PATH=/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin "$container"
$BUILDAH commit --quiet "$container" "$image" >/dev/null
echo "$image made"
