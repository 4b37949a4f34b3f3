#!/bin/sh
# Put a model in use, with its signature if it has one.
#
#   sudo deploy/install_model.sh MODEL.onnx
#
# If the service does not run with it, the model before is taken again. To go back to an older model,
# have it signed again and install it: its new signature has a higher version.
set -eu
. "$(dirname "$0")/links.sh"

model=${1:-}
[ -f "$model" ] || fail "$model does not exist: expected the .onnx file of a model"
number=$(sha256sum "$model" "$model.sig" 2> /dev/null | sha256sum | cut -c1-12)
name="model-$number.onnx"
before=$(readlink "$root/model.onnx" || true)
cp "$model" "$root/$name"
if [ -e "$model.sig" ]; then
    cp "$model.sig" "$root/$name.sig"
    if ! "$root/current/bin/edgetree" trust --check "$root/$name"; then
        [ "$name" = "$before" ] || rm "$root/$name" "$root/$name.sig"
        fail "$model is refused: ${before:-no model} stays in use"
    fi
fi

point model.onnx "$name"
if ! restart; then
    [ -n "$before" ] || fail "the service does not run with $model: see journalctl -u edgetree"
    point model.onnx "$before"
    restart || fail "the service runs neither with $model nor with $before again: if the journal says that $before is too old, have it signed again"
    fail "the service does not run with $model: went back to $before, see journalctl -u edgetree"
fi
echo "$name is in use; ${before:-none} was before"
