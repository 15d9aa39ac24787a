#!/usr/bin/env bash
# Runs a real Slurm cluster on this machine, for tests: two nodes, loopback only, no systemd, no cgroups, no database.
#   cluster.sh install            install Debian's packages, as root
#   cluster.sh up DIR             start; then: export SLURM_CONF=DIR/slurm.conf
#   cluster.sh kill DIR NODE      lose a node: kill -9 its daemon and everything that runs on it
#   cluster.sh node DIR NODE      start that node's daemon again
#   cluster.sh down DIR           stop
# Slurm's helpers must be able to enter DIR; /tmp is a good place. Comments explain the settings that matter.
set -euo pipefail
# (Do not pipe into `grep -q`: it exits early, and then the other side of the pipe fails.)

install_slurm() {
  command -v slurmctld slurmd munged > /dev/null && return
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 install -y -qq --no-install-recommends slurm-wlm munge
}

up() {
  local dir=$1 host memory port
  # Use separate ports, so that another cluster on this machine does not interfere.
  port=$((20000 + 10 * (RANDOM % 1000)))
  host=$(hostname -s)
  memory=$(awk '/MemTotal/ { print int($2 / 2048) - 512 }' /proc/meminfo)
  mkdir -p "$dir"/{state,log,run,spool/n1,spool/n2}
  chmod 755 "$dir" "$dir"/*
  grep -q '^127\.' <<< "$(getent hosts "$host")" || echo "127.0.0.1 $host" >> /etc/hosts
  # Slurm resolves names with AI_ADDRCONFIG, which finds nothing if 127.0.0.1 is the only address.
  grep -qv 'inet 127\.' <<< "$(ip -4 -o addr 2> /dev/null)" || ip addr add 10.255.255.1/32 dev lo
  mkdir -p "$dir/munge"
  head -c 128 /dev/urandom > "$dir/munge/key"
  chown -R munge:munge "$dir/munge"
  chmod 755 "$dir/munge"
  chmod 400 "$dir/munge/key"
  runuser -u munge -- munged --key-file="$dir/munge/key" --socket="$dir/munge/socket" --log-file="$dir/munge/log" \
    --pid-file="$dir/munge/pid" --seed-file="$dir/munge/seed"
  cat > "$dir/slurm.conf" << CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$dir/munge/socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SchedulerParameters=sched_min_interval=0,batch_sched_delay=0,sched_interval=1,bf_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
DefMemPerCPU=256
# A node that does not respond is down after this many seconds, and its jobs are requeued.
SlurmdTimeout=5
JobRequeue=1
ReturnToService=2
KillWait=2
MinJobAge=3600
# Small, so that a test reaches it.
MaxArraySize=9
SlurmctldPort=$port
SlurmctldPidFile=$dir/run/slurmctld.pid
SlurmdPidFile=$dir/run/slurmd.%n.pid
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool/%n
SlurmctldLogFile=$dir/log/slurmctld.log
SlurmdLogFile=$dir/log/slurmd.%n.log
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=2 RealMemory=$memory State=UNKNOWN
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=2 RealMemory=$memory State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
  export SLURM_CONF="$dir/slurm.conf"
  slurmctld -f "$SLURM_CONF"
  slurmd -N n1 -f "$SLURM_CONF"
  slurmd -N n2 -f "$SLURM_CONF"
  for _ in $(seq 100); do
    [ "$(timeout 2 sinfo -h -N -o %t 2> /dev/null | grep -c '^idle$')" = 2 ] && return
    sleep 0.1
  done
  echo "the cluster does not come up:" >&2
  tail -n 5 "$dir"/log/*.log >&2
  return 1
}

# All descendants of a process, leaves first.
below() {
  local child
  for child in $(pgrep -P "$1"); do
    below "$child"
    echo "$child"
  done
}

kill_node() {
  local dir=$1 node=$2 step script
  kill -9 "$(cat "$dir/run/slurmd.$node.pid")"
  # The node's steps are not children of the daemon, but they keep its log open.
  for step in $(pgrep slurmstepd || true); do
    if grep -q "$dir/log/slurmd.$node.log" <<< "$(ls -l "/proc/$step/fd" 2> /dev/null)"; then
      kill -9 "$step" || true
    fi
  done
  for script in $(pgrep -f "$dir/spool/$node/job" || true); do
    # shellcheck disable=SC2046
    kill -9 $(below "$script") "$script" 2> /dev/null || true
  done
}

# Returns only when all daemons have exited: slurmctld saves its state on exit.
down() {
  local pid pids=()
  for pid in "$1"/run/slurmd.*.pid "$1/run/slurmctld.pid" "$1/munge/pid"; do
    if [ -s "$pid" ]; then pids+=("$(cat "$pid")"); fi
  done
  # A lost node has a PID file but no process.
  for pid in "${pids[@]}"; do kill "$pid" 2> /dev/null || true; done
  for _ in $(seq 100); do
    any_alive "${pids[@]}" || return 0
    sleep 0.1
  done
  for pid in "${pids[@]}"; do kill -9 "$pid" 2> /dev/null || true; done
}

any_alive() {
  local pid
  for pid in "$@"; do
    if kill -0 "$pid" 2> /dev/null; then return 0; fi
  done
  return 1
}

case "${1:-}" in
  install) install_slurm ;;
  up) up "$2" ;;
  kill) kill_node "$2" "$3" ;;
  node) slurmd -N "$3" -f "$2/slurm.conf" ;;
  down) down "$2" ;;
  *) sed -n '2,8p' "$0"; exit 2 ;;
esac
