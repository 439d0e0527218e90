"""Plug-ins of every kind that misbehave: what each does once, when the bench first calls it."""

from __future__ import annotations

SCENARIO = """\
name: plugged
truth: {{source: {truth}, duration_s: 1, rate_hz: 10, objects: {{car: {{start: {{x: 20, y: 5, speed_mps: 10}}}}}}}}
sensors:
  lidar: {{type: {sensor}, rate_hz: 10, position_sigma_m: 0.15}}
trackers:
  mine: {{use: {tracker}}}
  ekf: {{filter: ekf, motion: {motion}, acceleration_sigma_mps2: 3}}
score: {{settle_s: 0, metrics: [{metric}]}}
monte_carlo: {{runs: 2, seed: 7}}
expect: [{{tracker: ekf, metric: position_rmse, below: {below}}}]
"""
#: What stands in the scenario where a plug-in of another kind misbehaves.
SOUND = {"tracker": "raw", "motion": "cv", "sensor": "lidar", "truth": "scripted", "metric": ""}

PLUG_INS = """\
import asyncio, atexit, builtins, ctypes, gc, os, posix, resource, shutil, signal, socket, subprocess, sys, threading
import time, warnings; from pathlib import Path
import numpy as np
from trackbench.metrics import Metric
from trackbench.models.motion.cv import ConstantVelocity
from trackbench.models.sensors.lidar import Lidar
from trackbench.trackers.raw import RawTracker
from trackbench.truth.sources import ScriptedTruth

done = False

def act():
    global done
    if not done:
        done = True
        misbehave()

def misbehave():
    {act}

class tracker(RawTracker):
    def step(self, state, scan):
        act()
        return super().step(state, scan)

"""
#: Those that run in the process of the command, each of which calls ``act``.
OF_THE_BENCH = """\
class motion(ConstantVelocity):
    def transition(self, *arguments):
        act()
        return super().transition(*arguments)

class sensor(Lidar):
    def sigmas(self):
        # The command itself asks for them too: act where the noise is drawn.
        if sys._getframe(1).f_code.co_name == "noisy_measurements":
            act()
        return super().sigmas()

class truth(ScriptedTruth):
    def load(self, *arguments, **options):
        act()
        return super().load(*arguments, **options)

class metric(Metric):
    "Counts nothing."
    name, unit, meaning = "own", "1", "nothing"
    def init(self, scope):
        act()
        return 0
    def update(self, sums, chunk): return sums
    def merge(self, blocks): return 0
    def finish(self, sums): return 0.0
"""
SLEEPER = "[sys.executable, '-c', 'import time; time.sleep(600)']"
FORGED = (
    "os.makedirs('results/plugged', exist_ok=True); open('results/plugged/result.json', 'w').write('{}'); os._exit(0)"
)
ACTS = {
    "raises": "raise ValueError('odd')",
    "raises_lines": "raise ValueError('one\\ntwo' * 1000)",
    "raises_half_a_character": "raise ValueError('\\ud800')",
    "raises_without_text": "raise type('Mute', (Exception,), {'__str__': lambda self: 1 / 0})",
    "raises_an_os_error": "raise OSError(28, 'No space left on device')",
    "raises_a_broken_pipe": "raise BrokenPipeError(32, 'Broken pipe')",
    "raises_a_memory_error": "raise MemoryError",
    "raises_a_keyboard_interrupt": "raise KeyboardInterrupt",
    "raises_a_generator_exit": "raise GeneratorExit",
    "raises_a_stop_iteration": "raise StopIteration",
    "raises_cancelled": "raise asyncio.CancelledError",
    "raises_base": "raise type('Base', (BaseException,), {})('odd')",
    "raises_system_exit": "raise SystemExit",
    "exits": "sys.exit(0)",
    "exits_with_text": "sys.exit('all is well')",
    "prints_half_a_character": "print('\\ud800')",
    "recurses": "misbehave()",
    "leaves": "os._exit(0)",
    "leaves_by_posix": "posix._exit(0)",
    "leaves_by_libc": "ctypes.CDLL(None).exit(0)",
    "leaves_by_the_system_call": "ctypes.CDLL(None).syscall(231, 0)",
    "leaves_in_a_thread": "threading.Thread(target=posix._exit, args=(0,)).start(); time.sleep(60)",
    "leaves_at_the_end": "atexit.register(posix._exit, 0)",
    "leaves_with_a_forged_result": FORGED,
    "becomes_another": "os.execv('/bin/true', ['true'])",
    "goes_on_as_a_copy": "if os.fork(): posix._exit(0)",
    "segfaults": "ctypes.string_at(0)",
    "aborts": "os.abort()",
    "kills_itself": "os.kill(os.getpid(), signal.SIGKILL)",
    "terminates": "os.kill(os.getpid(), signal.SIGTERM)",
    "hangs_up": "os.kill(os.getpid(), signal.SIGHUP)",
    "leaves_a_child": f"subprocess.Popen({SLEEPER})",
    "leaves_a_thread": "threading.Thread(target=time.sleep, args=(600,), daemon=True).start()",
    "closes_all_files": "os.closerange(3, 4096)",
    "moves_away": "os.chdir('/')",
    "replaces_exits": "sys.exit = os._exit = lambda *_: None",
    "clears_modules": "sys.modules.clear()",
    "takes_the_streams_away": "sys.stdout = sys.stderr = None",
    "breaks_open": "builtins.open = None",
    "breaks_json": "__import__('json').dumps = None",
    "forbids_recursion": "sys.setrecursionlimit(50)",
    "removes_results": "shutil.rmtree('results', ignore_errors=True)",
    "removes_results_at_the_end": "atexit.register(shutil.rmtree, 'results')",
    "makes_results_a_file": "shutil.rmtree('results', ignore_errors=True); open('results', 'w').close()",
    "makes_the_folder_a_file": "os.makedirs('results', exist_ok=True); open('results/plugged', 'w').close()",
    "breaks_pickle": "__import__('pickle').dumps = None",
    "breaks_unpickling": "__import__('pickle').loads = None",
    "breaks_pickling_of_arrays": "__import__('copyreg').pickle(np.ndarray, lambda array: 1 / 0)",
    "renames_nothing": "os.replace = os.rename = lambda *_, **__: None",
    "writes_nothing": "Path.write_text = Path.write_bytes = lambda *_, **__: 0",
    "closes_stdout": "sys.stdout.close()",
    "closes_the_true_stdout": "sys.__stdout__.close()",
    "closes_the_streams": "os.close(1); os.close(2)",
    "raises_at_the_end": "atexit.register(lambda: 1 / 0)",
    "raises_in_a_thread": "thread = threading.Thread(target=lambda: 1 / 0); thread.start(); thread.join()",
    "raises_as_it_is_deleted": "type('D', (), {'__del__': lambda self: 1 / 0})()",
    "logs_nonsense": "__import__('logging').error('%d', 'x')",
    "forbids_open_files": "resource.setrlimit(resource.RLIMIT_NOFILE, (5, 5))",
    "forbids_rights": "os.umask(0o777)",
    "prints_without_end": "print('\\x1b[2J' + 'line\\n' * 10**6)",
}


def scenario(kind: str, below: float = 100) -> str:
    """A scenario with the plug-in of one kind that is in ``plug.py``; an error ``below`` so many m is expected."""
    return SCENARIO.format(**(SOUND | {kind: f"'plug:{kind}'"}), below=below)


def module(act: str) -> str:
    """The text of ``plug.py`` whose plug-ins do an act once."""
    return PLUG_INS.replace("{act}", ACTS[act]) + OF_THE_BENCH
