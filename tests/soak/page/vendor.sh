#!/usr/bin/env bash
# Write what the page takes from others into a folder: vendor.sh FOLDER
set -euo pipefail
out=$(realpath "$1")
cd "$(dirname "${BASH_SOURCE[0]}")"
node_modules/.bin/esbuild three.js --bundle --minify --format=esm --legal-comments=inline --target=es2022 \
    --log-level=error --outfile="$out/three.js"
cp node_modules/three/LICENSE "$out/three.LICENSE.txt"
swagger=node_modules/swagger-ui-dist
cp $swagger/swagger-ui-bundle.js $swagger/swagger-ui-bundle.js.LICENSE.txt "$out"
cp $swagger/LICENSE "$out/swagger-ui.LICENSE.txt"
cp $swagger/NOTICE "$out/swagger-ui.NOTICE.txt"
# Browsers would ask for the map, which is left out.
sed '/sourceMappingURL/d' $swagger/swagger-ui.css >"$out/swagger-ui.css"
