#!/bin/sh
# Runs in the guest once systemd has brought it up. Writes what systemd says into /results; judges nothing.
set -u
say() { # name value
    echo "$1 $2" >>/results
}
property() { # name
    systemctl show hmd --value --property "$1"
}
journal() { # text: whether the service said it since its last start of a section
    journalctl --unit hmd --since "@$since" --output cat --no-pager | grep -c -m 1 -- "$1"
}
active() { # name: after at most 20 s in a state that lasts
    tries=0
    while [ $tries -lt 40 ]; do
        state=$(property ActiveState)
        case $state in active | failed | inactive) break ;; esac
        sleep 0.5
        tries=$((tries + 1))
    done
    say "$1.active" "$state"
}
section() {
    since=$(date +%s)
}
until_true() { # condition: at most 60 s
    tries=0
    until eval "$1" || [ $tries -ge 120 ]; do
        sleep 0.5
        tries=$((tries + 1))
    done
}

rm -f /results
# The guest's own file system gives every file to root.
mkdir -p /var/lib/hmd
mount -t tmpfs tmpfs /var/lib/hmd
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; do
    insmod "/usr/lib/uml/modules/$(uname -r)/kernel/$module.ko"
done
ip link add dev can0 type vcan
ip link set can0 up

section
for block in actuator configuration service; do
    (cd /page && sh -e "./$block") >"/page/$block.out" 2>&1
    say page.$block $?
done
until_true '[ "$(journal "flap-left: unknown to \(warning\|critical\)")" = 1 ]'
# Metrics are a second old at most.
sleep 2
(cd /page && sh -e ./look) >/page/look.out 2>&1
say page.look $?
say page.journal "$(grep -c -m 1 'flap-left: unknown to \(warning\|critical\)' /page/look.out)"
say page.scrape "$(grep -c -m 1 '^hmd_health{.*flap-left.*} [34]' /page/look.out)"
say page.report "$(grep -c -m 1 'flap-left' /root/report.html)"
say page.seconds "$(($(date +%s) - since))"
cp /root/report.html /page/
(cd /page && sh -e ./end) >/page/end.out 2>&1
say page.end $?
systemctl disable hmd

section
# A key that there is not.
echo >/hmd.toml
cp /hmd.toml /etc/hmd/hmd.toml
echo 'persistance = 3' >>/etc/hmd/hmd.toml
systemctl start hmd
sleep 5
active bad
say bad.status "$(property ExecMainStatus)"
say bad.restarts "$(property NRestarts)"
say bad.reason "$(journal persistance)"

section
printf '[[actuator]]\nid = 0\nname = "flap-left"\nbus = "can0"\n' | cat /hmd.toml - >/etc/hmd/hmd.toml
systemctl reset-failed hmd
systemctl enable --now hmd
active good
say good.ready "$(property SubState | grep -c running)"
say good.enabled "$(systemctl is-enabled hmd)"
process=$(property MainPID)

section
canplayer -I /worn.log
sleep 3
say worn.warning "$(journal 'flap-left.*warning')"

section
echo 'persistance = 3' >>/etc/hmd/hmd.toml
systemctl reload hmd
sleep 3
active reload-bad
say reload-bad.same-process "$([ "$(property MainPID)" = "$process" ] && echo 1 || echo 0)"
say reload-bad.reason "$(journal persistance)"

section
sed -i '$d' /etc/hmd/hmd.toml
systemctl reload hmd
sleep 3
active reload-good
say reload-good.same-process "$([ "$(property MainPID)" = "$process" ] && echo 1 || echo 0)"

section
kill -KILL "$process"
until_true '[ "$(property NRestarts)" = 1 ]'
sleep 2
active crash
say crash.restarts "$(property NRestarts)"

section
kill -STOP "$(property MainPID)"
until_true '[ "$(property NRestarts)" = 2 ]'
sleep 2
active hang
say hang.restarts "$(property NRestarts)"
say hang.watchdog "$(journal 'Watchdog timeout')"

section
systemctl stop hmd
active stop
say stop.result "$(property Result)"
say stop.unfinished "$(find /var/lib/hmd -name '*.part' | wc -l)"
say denied "$(journalctl --no-pager --output cat | grep -cE 'SECCOMP auid|status=31/SYS')"
journalctl --no-pager >/journal
ls -la /var/lib/hmd >/files
say done 1
systemctl poweroff --force --force
