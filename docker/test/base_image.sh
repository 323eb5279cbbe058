#!/usr/bin/env bash
# Makes a local stand-in for an image that is built on, or run, where no image registry is reached.
#   base_image.sh python:3.13-slim-trixie    that Debian release, with its Python under the names of the real image
#   base_image.sh nginx:1.29-alpine          Debian's newest nginx, which must be no older
# Made once and kept in the storage of $BUILDAH; made anew when this file changes.
set -euo pipefail

name=$1
if [[ $name =~ ^python:([0-9]+\.[0-9]+)-slim-([a-z]+)$ ]]; then
    version=${BASH_REMATCH[1]} release=${BASH_REMATCH[2]}
    from=("$release")
    packages=ca-certificates,python3,python3-venv
elif [[ $name =~ ^nginx:([0-9]+\.[0-9]+)-alpine$ ]]; then
    version=${BASH_REMATCH[1]} release=testing
    # The script by which debootstrap makes releases that are newer than itself.
    from=(testing http://deb.debian.org/debian sid)
    packages=nginx-light,wget
else
    echo "no recipe for the image $name" >&2
    exit 1
fi
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
debootstrap --variant=minbase --include="$packages" "${from[0]}" "$root" "${from[@]:1}" >"$log" 2>&1 || {
    tail -n 30 "$log" >&2
    exit 1
}
rm -rf "$log" "$root"/var/cache/apt/archives/*.deb "$root"/var/lib/apt/lists/*
# debootstrap copies these two from the machine that it runs on.
: >"$root/etc/resolv.conf"
echo localhost >"$root/etc/hostname"
echo '127.0.0.1 localhost' >"$root/etc/hosts"

if [[ $name == python:* ]]; then
    ln -s /usr/bin/python3 "$root/usr/local/bin/python3"
    ln -s python3 "$root/usr/local/bin/python"
    found=$(chroot "$root" python -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    [[ $found == "$version" ]] || { echo "$release has Python $found, and $name asks for $version" >&2; exit 1; }
    command=python3
else
    found=$(chroot "$root" nginx -v 2>&1 | sed 's/.*nginx\///')
    [[ $(printf '%s\n' "$version" "$found" | sort --version-sort | head -n 1) == "$version" ]] ||
        { echo "$release has nginx $found, and $name asks for $version" >&2; exit 1; }
    command='["nginx", "-g", "daemon off;"]'
fi

$BUILDAH config --label "recipe=$recipe" --cmd "$command" \
    --env PATH=/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin "$container"
$BUILDAH commit --quiet "$container" "$image" >/dev/null
echo "$image made"
