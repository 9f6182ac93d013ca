"""Time and memory of one computation in this process; the same measures as nodes/kernels/examples/peers/meter.rs."""
import json
import time


def _resident(field):
    with open("/proc/self/status") as status:
        return next(1024 * int(line.split()[1]) for line in status if line.startswith(field))


def measured(work):
    """The result of `work()` and its cost: wall seconds, CPU seconds of all threads, peak bytes above what was resident before."""
    with open("/proc/self/clear_refs", "w") as reset:
        reset.write("5")  # the high-water mark starts from here
    before, cpu, wall = _resident("VmRSS:"), time.process_time(), time.perf_counter()
    result = work()
    cost = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    cost["memory"] = max(0, _resident("VmHWM:") - before)
    return result, cost


def report(cost, **rest):
    print(json.dumps({**cost, **rest}), flush=True)
