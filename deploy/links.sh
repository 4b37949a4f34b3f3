# What update.sh, roll_back.sh and install_model.sh share: links that change in one step, and the
# restart of the service. Read with ".", by sh.
root=${EDGETREE_ROOT:-/opt/edgetree}

fail() {
    echo "$(basename "$0"): $1" >&2
    exit 2
}

[ -w "$root" ] || fail "$root cannot be written: expected an existing folder, and sudo"

# Let the link $root/$1 lead to $2, in one step.
point() {
    ln -sfn "$2" "$root/$1.next"
    mv -T "$root/$1.next" "$root/$1"
}

# Restart the service, and see whether it still runs some seconds later.
restart() {
    systemctl restart edgetree && sleep "${EDGETREE_WAIT_S:-5}" && systemctl is-active --quiet edgetree
}
