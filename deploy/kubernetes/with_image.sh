#!/bin/sh
# with_image.sh REGISTRY/NAME@sha256:... FILE...: print manifests with this image. A tag is refused, because it can be
# moved to another image.
set -eu
image=$1
shift
"$(dirname "$0")/../has_digest.sh" "$image"
for file in "$@"; do
    sed "s|clearcap@DIGEST|$image|" "$file"
    echo ---
done
