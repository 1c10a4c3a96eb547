#!/usr/bin/env python3
"""A pose source on one host, the simulator on another, a bad link between.

    test/network/two_machines.py [--build build] [--delay-ms 20] [--jitter-ms 5] [--loss 0.01] [--clock 7]

Two network namespaces stand for the hosts. Each has a TUN device; the link between them is this
program, which delays every packet, lets some overtake others, drops some, and can be cut. So the
kernel needs no netem. Wants root and /dev/net/tun; says so and exits with 77 where it has not.

Checks, and exits with 1 if one fails:
  - every pose is accepted, in order, and the state has the bits of stroke_replay on the same bag;
  - clocks that differ are noticed and said with the figure;
  - a cut link in the middle of a stroke holds the tip, and the stroke goes on as if nothing had been.
"""
import argparse
import fcntl
import heapq
import importlib.util
import os
import random
import select
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time

HERE = os.path.abspath(__file__)
SOURCE = os.path.dirname(os.path.dirname(os.path.dirname(HERE)))
SOURCE_IP, SIMULATOR_IP = '10.77.0.1', '10.77.0.2'
PORT = 11371


class Link(threading.Thread):
    """Carries IP packets between two TUN devices, badly."""

    def __init__(self, names, delay, jitter, loss):
        super().__init__(daemon=True)
        self.devices = [self.open(name) for name in names]
        self.delay, self.jitter, self.loss = delay, jitter, loss
        self.is_cut = False
        self.carried = self.dropped = 0
        self.random = random.Random(1)

    @staticmethod
    def open(name):
        device = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
        tunsetiff, tun_without_header = 0x400454ca, 0x1001
        fcntl.ioctl(device, tunsetiff, struct.pack('16sH', name.encode(), tun_without_header))
        return device

    def run(self):
        under_way, count = [], 0
        while True:
            wait = max(0.0, under_way[0][0] - time.monotonic()) if under_way else 0.1
            for device in select.select(self.devices, [], [], wait)[0]:
                try:
                    packet = os.read(device, 65536)
                except OSError:
                    return  # its namespace is gone
                other = self.devices[1 - self.devices.index(device)]
                if self.is_cut or self.random.random() < self.loss:
                    self.dropped += 1
                    continue
                count += 1
                due = time.monotonic() + max(0.0, self.random.gauss(self.delay, self.jitter))
                heapq.heappush(under_way, (due, count, other, packet))
            while under_way and under_way[0][0] <= time.monotonic():
                _, _, other, packet = heapq.heappop(under_way)
                try:
                    os.write(other, packet)
                    self.carried += 1
                except OSError:
                    self.dropped += 1  # the device is not up, or full


def environment(build, address, scratch):
    shell = ['bash', '-c', f'source {build}/devel/setup.bash >/dev/null && env -0']
    lines = subprocess.run(shell, stdout=subprocess.PIPE, check=True).stdout.split(b'\0')
    result = dict(line.decode().split('=', 1) for line in lines if b'=' in line)
    result.update(ROS_MASTER_URI=f'http://{SIMULATOR_IP}:{PORT}', ROS_IP=address, ROS_HOME=scratch,
                  ROS_LOG_DIR=scratch + '/log', ROSCONSOLE_FORMAT='[${severity}] ${message}')
    result.pop('ROS_HOSTNAME', None)
    return result


def send(bag_file, clock):
    """On the source's host: the poses of a bag in real time, stamped by a clock that is `clock` s ahead."""
    import rosbag
    import rospy
    from geometry_msgs.msg import PoseStamped
    rospy.init_node('source')
    publisher = rospy.Publisher('handle_pose', PoseStamped, queue_size=10000, tcp_nodelay=True)
    while publisher.get_num_connections() == 0:
        time.sleep(0.02)
    with rosbag.Bag(bag_file) as bag:
        poses = [message for _, message, _ in bag.read_messages()]
    first, begin, start = poses[0].header.stamp, rospy.Time.from_sec(time.time() + clock), time.monotonic()
    for pose in poses:
        elapsed = pose.header.stamp - first
        time.sleep(max(0.0, elapsed.to_sec() - (time.monotonic() - start)))
        pose.header.stamp = begin + elapsed
        publisher.publish(pose)
    time.sleep(60)  # until all is through the link; ended from outside


def watch():
    """On the simulator's host: prints what it says, one line an event, for the program outside."""
    import rospy
    from calligraphy_brush.msg import BrushState
    from geometry_msgs.msg import PoseStamped
    from std_srvs.srv import Trigger
    rospy.init_node('watch')

    def say(*words):  # one write: callbacks come from several threads
        sys.stdout.write(' '.join(str(word) for word in words) + '\n')
        sys.stdout.flush()

    state = {'newest': rospy.Time(), 'holding': False, 'refused': 0, 'taken': 0, 'clocks': 0.0}

    def accepted(pose):
        say('reordered' if pose.header.stamp <= state['newest'] else 'accepted')
        state['newest'] = pose.header.stamp

    def said(message):
        if message.holding != state['holding']:
            say('holds' if message.holding else 'moves', message.touching_rods)
        if message.clock_difference != state['clocks']:
            say('clocks', message.clock_difference)
        if message.poses_accepted != state['taken']:
            say('taken', message.poses_accepted)
        if message.poses_refused != state['refused']:
            say('refused', message.poses_refused)
        state.update(holding=message.holding, taken=message.poses_accepted, refused=message.poses_refused, clocks=message.clock_difference)

    rospy.Subscriber('accepted_pose', PoseStamped, accepted, queue_size=10000)
    rospy.Subscriber('brush_state', BrushState, said)
    services = {name: rospy.ServiceProxy('brush_simulator/' + name, Trigger) for name in ('reset', 'state_hash')}
    for service in services.values():
        service.wait_for_service(20)
    say('ready')
    for line in sys.stdin:
        answer = services[line.strip()]().message
        if line.strip() == 'reset':
            state.update(newest=rospy.Time(), refused=0, taken=0)
        say(line.strip(), answer)


class Watcher:
    """Lines of `watch`, counted."""

    def __init__(self, process):
        self.process, self.lines, self.changed = process, [], threading.Condition()
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.process.stdout:
            with self.changed:
                self.lines.append(line.split())
                self.changed.notify_all()

    def count(self, word):
        return sum(1 for line in self.lines if line and line[0] == word)

    def taken(self):
        """Poses accepted, as brush_state counts them."""
        counts = [int(line[1]) for line in self.lines if line and line[0] == 'taken']
        return counts[-1] if counts else 0

    def wait(self, is_so, seconds):
        with self.changed:
            return self.changed.wait_for(lambda: is_so(self), seconds)

    def ask(self, service):
        seen = self.count(service)
        self.process.stdin.write(service + '\n')
        self.process.stdin.flush()
        if not self.wait(lambda w: w.count(service) > seen, 20):
            raise RuntimeError(f'no answer from ~{service}')
        return [line for line in self.lines if line and line[0] == service][-1][1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--build', default=SOURCE + '/build')
    parser.add_argument('--delay-ms', type=float, default=20.0)
    parser.add_argument('--jitter-ms', type=float, default=5.0)
    parser.add_argument('--loss', type=float, default=0.01)
    parser.add_argument('--clock', type=float, default=7.0, help='how far ahead the clock of the source is [s]')
    parser.add_argument('--cut', type=float, default=2.0, help='how long the link is cut [s]')
    arguments = parser.parse_args()

    for module in ('geometry_msgs', 'std_srvs', 'rospy', 'rosbag'):
        if importlib.util.find_spec(module) is None:
            print(f'skipped: no Python module {module} (Debian: python3-{module.replace("_", "-")})')
            return 77

    scratch = tempfile.mkdtemp(prefix='two_machines_')
    spaces = [f'source_{os.getpid()}', f'simulator_{os.getpid()}']
    devices = [f'tuna{os.getpid()}'[:15], f'tunb{os.getpid()}'[:15]]
    processes, failures = [], []

    def run(*words):
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def start(host, words, **options):
        address = (SOURCE_IP, SIMULATOR_IP)[host]
        processes.append(subprocess.Popen(['ip', 'netns', 'exec', spaces[host], *words], text=True,
                                          env=environment(arguments.build, address, scratch),
                                          start_new_session=True, **options))
        return processes[-1]

    def end(process):
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)

    def check(is_so, what):
        print(('ok    ' if is_so else 'FAILED'), what, flush=True)
        if not is_so:
            failures.append(what)

    try:
        try:
            link = Link(devices, 1e-3 * arguments.delay_ms, 1e-3 * arguments.jitter_ms, arguments.loss)
            for host in (0, 1):
                run('ip', 'netns', 'add', spaces[host])
                run('ip', 'link', 'set', devices[host], 'netns', spaces[host])
                inside = ('ip', '-n', spaces[host])
                run(*inside, 'addr', 'add', (SOURCE_IP, SIMULATOR_IP)[host] + '/30', 'dev', devices[host])
                run(*inside, 'link', 'set', devices[host], 'up')
                run(*inside, 'link', 'set', 'lo', 'up')
        except (OSError, subprocess.CalledProcessError) as error:
            detail = getattr(error, 'stderr', None)
            print('skipped: no network namespaces or TUN devices here:', detail.decode().strip() if detail else error)
            return 77
        link.start()

        programs = arguments.build + '/devel/lib/calligraphy_brush'
        strokes, bag = scratch + '/strokes.yaml', scratch + '/strokes.bag'
        with open(strokes, 'w') as file:
            file.write('speed: 0.04\nstrokes:\n  - [[0.08, 0.20, 0.001], [0.12, 0.20, 0.005], [0.20, 0.20, 0.004]]\n'
                       '  - [[0.14, 0.24, 0.002], [0.14, 0.18, 0.005], [0.14, 0.12, 0.001]]\n')
        quiet = environment(arguments.build, SIMULATOR_IP, scratch)
        run_here = lambda *words: subprocess.run(words, check=True, env=quiet, stdout=subprocess.PIPE, text=True).stdout
        run_here(programs + '/stroke_writer', strokes, '--bag', bag, '--quiet')
        expected = run_here(programs + '/stroke_replay', bag, scratch + '/o.png', '--quiet', '--hash').strip()
        import_poses = run_here('/usr/bin/python3', '-c', f'import rosbag; print(rosbag.Bag("{bag}").get_message_count())')
        poses = int(import_poses)

        log = open(scratch + '/simulator.txt', 'w')
        start(1, ['roslaunch', '-p', str(PORT), SOURCE + '/launch/brush.launch', f'image:={scratch}/x.png'],
              stdout=log, stderr=log)
        watcher = Watcher(start(1, ['/usr/bin/python3', HERE, 'watch'], stdin=subprocess.PIPE,
                                stdout=subprocess.PIPE, stderr=log))
        if not watcher.wait(lambda w: w.count('ready') > 0, 60):
            raise RuntimeError('the simulator did not start: ' + open(log.name).read())

        def write(what, cut_after=None):
            watcher.ask('reset')
            watcher.lines = []
            source = start(0, ['/usr/bin/python3', HERE, 'send', bag, str(arguments.clock)], stderr=log)
            if cut_after is not None:
                watcher.wait(lambda w: w.taken() > cut_after * poses, 60)
                link.is_cut = True
                time.sleep(arguments.cut)
                held = [line for line in watcher.lines if line and line[0] == 'holds' and int(line[1]) > 0]
                before = watcher.taken()
                link.is_cut = False
                check(len(held) > 0, f'{what}: the tip holds on the sheet, and the simulator says so')
                check(before < poses, f'{what}: {before} of {poses} poses had come when the link was back')
            watcher.wait(lambda w: w.taken() >= poses, 60)
            time.sleep(1.2)
            count = watcher.taken()
            check(count == poses and watcher.count('reordered') == 0 and watcher.count('refused') == 0,
                  f'{what}: {count} of {poses} poses accepted, {watcher.count("reordered")} out of order, '
                  f'{watcher.count("refused")} refused')
            actual = watcher.ask('state_hash')
            check(actual == expected, f'{what}: state {actual}, offline {expected}')
            end(source)

        print(f'delay {arguments.delay_ms} ms, jitter {arguments.jitter_ms} ms, loss {arguments.loss:.1%}, '
              f'clock of the source {arguments.clock:+} s', flush=True)
        write('bad link')
        said = [float(line[1]) for line in watcher.lines if line and line[0] == 'clocks']
        check(bool(said) and abs(min(said, key=abs) + arguments.clock) < 0.3,
              f'brush_state has how far the clocks differ: {said[-1] if said else None} s')
        log.flush()
        warned = [line for line in open(log.name) if 'clocks of the hosts differ' in line]
        check(len(warned) == 1, f'the log says so once: {warned[0].strip() if warned else None}')
        write('cut link', cut_after=0.4)
        print(f'{link.carried} packets carried, {link.dropped} dropped')
        for line in open(log.name):
            if 'the tip holds' in line:
                print('      ' + line.strip())
    finally:
        for process in reversed(processes):
            end(process)
        for space in spaces:
            subprocess.run(['ip', 'netns', 'del', space], stderr=subprocess.DEVNULL, check=False)
        subprocess.run(['rm', '-rf', scratch], check=False)
    return 1 if failures else 0


if __name__ == '__main__':
    if sys.argv[1:2] == ['send']:
        send(sys.argv[2], float(sys.argv[3]))
    elif sys.argv[1:2] == ['watch']:
        watch()
    else:
        sys.exit(main())
