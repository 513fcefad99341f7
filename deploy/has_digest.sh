#!/bin/sh
# has_digest.sh IMAGE: fail unless the image is named by its digest
set -eu
if printf '%s\n' "$1" | grep -Eqvx '[a-z0-9][a-z0-9./:_-]*@sha256:[0-9a-f]{64}'; then
    echo "$1: not an image with its digest, such as registry.example/name@sha256:..." >&2
    exit 2
fi
