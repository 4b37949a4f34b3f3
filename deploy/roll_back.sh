#!/bin/sh
# Go back to the version that ran before the last update. The model stays as it is.
#
#   sudo deploy/roll_back.sh
#
# Called again, it goes forward to the newer one.
set -eu
. "$(dirname "$0")/links.sh"

now=$(readlink "$root/current") || fail "$root/current is no link: expected an installed version"
before=$(readlink "$root/previous") || fail "there is no version before $now: expected an update first"
[ -x "$root/$before/bin/edgetree" ] || fail "$root/$before was removed: expected the version before $now"
hold_on
point current "$before"
point previous "$now"
restart || fail "the service does not run with version $before: see journalctl -u edgetree"
echo "version $before is in use; $now was before"
