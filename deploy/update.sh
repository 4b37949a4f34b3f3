#!/bin/sh
# Install the version in a bundle beside the others, check it, and switch to it.
#
#   sudo deploy/update.sh BUNDLE
#
# BUNDLE is a folder with wheels/ and runtime.txt, sign.txt if models are signed, and extras.txt if the
# set-up needs other packages. The version that ran before is kept for roll_back.sh, and is taken again
# if the service does not run with the new one.
set -eu
. "$(dirname "$0")/links.sh"

bundle=${1:-}
[ -d "$bundle" ] || fail "${bundle:-no folder} is given: expected update.sh BUNDLE, an existing folder"
wheel=$(ls "$bundle"/wheels/edgetree-*.whl 2> /dev/null || true)
[ -f "$wheel" ] || fail "$bundle holds $(echo "$wheel" | grep -c .) wheels of edgetree: expected wheels/edgetree-VERSION-py3-none-any.whl"
version=$(basename "$wheel" | cut -d- -f2)
before=$(readlink "$root/current" || true)
stays="${before:-no version} stays in use"
[ "$before" != "$version" ] || fail "version $version is in use already: expected a bundle of another"

if [ ! -e "$root/$version/complete" ]; then
    rm -rf "${root:?}/$version" # what an interrupted update left
    python3 -m venv "$root/$version" || fail "python3 makes no environment: expected the package python3-venv"
    for list in runtime sign extras; do
        [ ! -e "$bundle/$list.txt" ] ||
            "$root/$version/bin/pip" install --no-index --find-links "$bundle/wheels" -r "$bundle/$list.txt" ||
            fail "$list.txt cannot be installed: expected wheels for $(uname -m) and $(python3 --version); $stays"
    done
    "$root/$version/bin/pip" install --no-index --no-deps "$wheel" || fail "$wheel cannot be installed: $stays"
    touch "$root/$version/complete"
fi
"$root/$version/bin/edgetree" doctor || fail "version $version is not healthy: $stays"
if [ -e "$root/model.onnx.sig" ] || [ -e "$(readlink -f "$root/model.onnx").sig" ]; then
    accepts "$version" "$root/model.onnx" ||
        fail "version $version refuses the model in use: $stays"
fi

last=$(readlink "$root/previous" || true)
hold_on
[ -z "$before" ] || point previous "$before" # first, so that a power failure leaves a way back
point current "$version"
if ! restart; then
    [ -n "$before" ] || fail "the service does not run with version $version: see journalctl -u edgetree"
    point current "$before"
    point previous "$last"
    restart || fail "the service runs neither with version $version nor with $before again: see journalctl -u edgetree"
    fail "the service does not run with version $version: went back to $before, see journalctl -u edgetree"
fi
echo "version $version is in use; ${before:-none} was before"
