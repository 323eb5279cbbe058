#!/bin/sh
# The kernels that were compiled with the image go to where the compiler keeps them: a folder that it can write to, so
# that on another kind of processor it can add its own. Without them every start would compile for half a minute.
set -eu
mkdir -p "$NUMBA_CACHE_DIR"
cp -R /opt/isoshape/kernels/. "$NUMBA_CACHE_DIR"
exec "$@"
