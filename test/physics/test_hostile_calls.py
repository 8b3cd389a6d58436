"""No call of the core crashes or depends on the calls before it; see `hostile_calls.py`."""

import subprocess
import sys
from pathlib import Path


def test_any_types_shapes_and_orders_of_calls_give_the_rules_answer_or_a_sentence():
    script = Path(__file__).with_name("hostile_calls.py")
    done = subprocess.run([sys.executable, "-W", "error", str(script)], capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, f"exit status {done.returncode} after: {done.stdout}\n{done.stderr}"
