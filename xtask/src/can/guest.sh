# Runs as init of the user-mode Linux; WORK, HMD, FIRMWARE, PYTHON, ADAPTER and SEED are set above. Writes what happened into $WORK; judges nothing.
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sys /sys
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan \
    drivers/net/can/slcan/slcan; do
    busybox insmod $modules/$module.ko
done
mkdir -p /dev/pts
mount -t devpts devpts /dev/pts -o ptmxmode=0666
ip link set lo up
cd "$WORK"

add() { # interface…: with room for CAN FD, up
    for interface; do
        ip link add dev $interface type vcan
        ip link set $interface mtu 72
        ip link set $interface up
    done
}
sent() { # interface: every frame that anybody sent on it
    cat /sys/class/net/$1/statistics/tx_packets
}
start() { # name, arguments of hmd: starts it and waits until it listens
    name=$1
    shift
    "$HMD" "$@" >$name.jsonl 2>$name.err &
    daemon=$!
    until_said $name ': up'
}
until_said() { # name, text: at most 10 s
    tries=0
    while ! grep -q "$2" $1.err && [ $tries -lt 100 ]; do
        sleep 0.1
        tries=$((tries + 1))
    done
}
stop() { # name
    kill -TERM $daemon
    wait $daemon
    echo "$1.exit $?" >>results
}

# 1. Sixteen actuators on three interfaces.
add vcan0 vcan1 vcan2
start stream run -c stream.toml -o stream.mcap --json
players=
for bus in 0 1 2; do
    canplayer -I stream$bus.log &
    players="$players $!"
done
wait $players
sleep 2
stop stream
for bus in 0 1 2; do
    echo "stream.sent$bus $(sent vcan$bus)" >>results
    ip link del vcan$bus
done

# 2. FD frames, foreign frames, error frames, then a flood as fast as the kernel takes it.
add vcan0 vcan1
start bus run -c bus.toml -o bus.mcap --json
canplayer -I fd.log
canplayer -I foreign.log
for error in 20000004#0008000000000000 20000004#0020000000000000 20000004#0040000000000000 \
    20000040#0000000000000000 20000100#0000000000000000; do
    cansend vcan0 $error
done
sleep 1
for bus in 0 1; do
    cangen vcan$bus -g 0 -p 10 -I 100 -L 8 -n 60000 &
    flood="$flood $!"
done
wait $flood
sleep 2
stop bus
for bus in 0 1; do
    echo "bus.sent$bus $(sent vcan$bus)" >>results
    ip link del vcan$bus
done

# 3. An interface that is missing at the start, comes, is switched off and on, deleted and made again.
"$HMD" run -c link.toml -o link.mcap --json >link.jsonl 2>link.err &
daemon=$!
until_said link missing
add vcan0
until_said link ': up'
cansend vcan0 100#0000000000000000
ip link set vcan0 down
until_said link down
ip link set vcan0 up
# At once: nothing is lost while the daemon does not know yet that the interface is back.
cansend vcan0 100#0000000000000100
sleep 3
echo "link.sent0 $(sent vcan0)" >>results
ip link del vcan0
sleep 2
cp link.err link.deleted
add vcan0
sleep 3
cansend vcan0 100#0000000000000200
sleep 1
stop link
echo "link.sent1 $(sent vcan0)" >>results

# 4. Capture alone: every frame, whatever its identifier.
start record record vcan0 -o record.mcap
before=$(sent vcan0)
canplayer -I fd.log
canplayer -I foreign.log
sleep 1
stop record
echo "record.sent0 $(($(sent vcan0) - before))" >>results

# 5. A serial adapter, which the kernel makes an interface of. It prints how many frames it had, and was asked to send.
rm -f adapter
"$PYTHON" "$ADAPTER" slcan.log adapter >adapter.counts 2>adapter.err &
adapter=$!
tries=0
while [ ! -e adapter ] && [ $tries -lt 100 ]; do
    sleep 0.1
    tries=$((tries + 1))
done
slcand -o -s8 "$(readlink adapter)" slcan0
sleep 1
ip link set slcan0 up
start slcan run -c slcan.toml -o slcan.mcap --json
wait $adapter
stop slcan
read -r played asked <adapter.counts
echo "slcan.played $played" >>results
echo "slcan.asked $asked" >>results

# 6. Interface, actuator and daemon come, go and start again in an order drawn from the seed. After each event two more
# actuations must be judged, without another hand.
ip link del vcan0
actuator() { # starts again by itself when its bus is gone
    number=0
    while [ ! -e order.over ]; do
        number=$((number + 1))
        "$FIRMWARE" --can vcan0 --rate 400 --profile step --windows 1000 --seed $number 2>/dev/null &
        echo $! >order.actuator
        wait $!
        sleep 0.1
    done
}
restart_actuator() {
    kill $(cat order.actuator)
}
watch() {
    runs=$((runs + 1))
    "$HMD" run -c link.toml -o order$runs.mcap --json >>order.jsonl 2>>order.err &
    daemon=$!
}
restart_daemon() {
    kill -TERM $daemon
    wait $daemon
    ended=$?
    # Data were lost, or not.
    [ $ended = 0 ] || [ $ended = 3 ] || failed=$((failed + 1))
    watch
}
judged() {
    grep -c '"k":\[' order.jsonl
}
until_judged() { # at most 20 s
    wanted=$(($(judged) + 2))
    tries=0
    while [ $(judged) -lt $wanted ] && [ $tries -lt 200 ]; do
        sleep 0.1
        tries=$((tries + 1))
    done
    [ $(judged) -ge $wanted ]
}
draw() { # number of possibilities
    SEED=$(((SEED * 1103515245 + 12345) & 0x7fffffff))
    drawn=$(((SEED >> 16) % $1))
}
runs=0
failed=0
good=0
events=0
: >order.jsonl
watch
actuator &
add vcan0
until_judged && good=$((good + 1))
while [ $events -lt 16 ]; do
    events=$((events + 1))
    draw 10
    sleep 0.$drawn
    draw 6
    case $drawn in
    0) ip link set vcan0 down; sleep 0.5; ip link set vcan0 up ;;
    1) ip link del vcan0; sleep 0.5; add vcan0 ;;
    2) restart_actuator ;;
    3) restart_daemon ;;
    4) ip link del vcan0; restart_actuator; sleep 0.5; add vcan0 ;;
    5) ip link del vcan0; restart_daemon; sleep 0.5; add vcan0 ;;
    esac
    if until_judged; then
        good=$((good + 1))
    else
        echo "event $events, $drawn: nothing judged" >>order.missed
    fi
done
: >order.over
restart_actuator
restart_daemon
kill -TERM $daemon
wait $daemon
echo "order.events $events" >>results
echo "order.good $good" >>results
echo "order.failed $failed" >>results

echo "done 1" >>results
halt -f
