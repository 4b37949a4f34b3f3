#!/bin/sh
# Put a model in use, with its signature if it has one.
#
#   sudo deploy/install_model.sh MODEL.onnx
#
# If the service does not run with it, the model before is taken again. To go back to an older model,
# have it signed again and install it: its new signature has a higher version.
set -eu
. "$(dirname "$0")/links.sh"

# Copy file $1 to $root/$2, whole and for the service's account to read.
copy() {
    install -m 644 "$1" "$root/$2.next"
    mv "$root/$2.next" "$root/$2"
}

# The name of a copy of model $1 with its signature.
name_of() {
    echo "model-$(sha256sum "$1" "$1.sig" 2> /dev/null | sha256sum | cut -c1-12).onnx"
}

config=${EDGETREE_CONFIG:-/etc/edgetree/edgetree.toml}
model=${1:-}
[ -f "$model" ] || fail "${model:-no file} is given: expected install_model.sh MODEL.onnx, an existing file"
[ ! -e "$config" ] || grep -q "^[^#]*$root/model.onnx" "$config" ||
    fail "$config does not name the model that this changes: expected model = \"$root/model.onnx\" in it"
hold_on
if [ -f "$root/model.onnx" ] && [ ! -L "$root/model.onnx" ]; then # a copy by hand, to go back to
    first=$(name_of "$root/model.onnx")
    [ ! -e "$root/model.onnx.sig" ] || mv "$root/model.onnx.sig" "$root/$first.sig"
    mv "$root/model.onnx" "$root/$first"
    point model.onnx "$first"
fi
name=$(name_of "$model")
before=$(readlink "$root/model.onnx" || true)
copy "$model" "$name"
if [ -e "$model.sig" ]; then
    copy "$model.sig" "$name.sig"
    if ! accepts current "$root/$name"; then
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
