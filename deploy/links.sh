# What update.sh, roll_back.sh and install_model.sh share: links that change in one step, and the
# restart of the service. Read with ".", by sh.
root=${EDGETREE_ROOT:-/opt/edgetree}
account=edgetree
state=/var/lib/edgetree
umask 022 # the service's account reads what root installs

fail() {
    echo "$(basename "$0"): $1" >&2
    exit 2
}

[ -w "$root" ] || fail "$root cannot be written: expected an existing folder, and sudo"

# Let the link $root/$1 lead to $2, in one step; without $2 there is none.
point() {
    if [ -n "$2" ]; then
        ln -sfn "$2" "$root/$1.next"
        mv -T "$root/$1.next" "$root/$1"
    else
        rm -f "$root/$1"
    fi
}

# Go on although the connection or the terminal ends: from here on links change.
hold_on() {
    trap '' HUP INT
}

# Whether version $1 accepts the signature of model $2: asked as the account of the service, whose used
# versions count, and not those of root.
accepts() {
    set -- "$root/$1/bin/edgetree" trust --check "$2"
    if id "$account" > /dev/null 2>&1; then
        set -- runuser -u "$account" -- env -u XDG_CONFIG_HOME HOME="$state" STATE_DIRECTORY="$state" "$@"
    fi
    "$@"
}

# Restart the service, and see whether it still runs some seconds later.
restart() {
    systemctl restart edgetree && sleep "${EDGETREE_WAIT_S:-5}" && systemctl is-active --quiet edgetree
}
