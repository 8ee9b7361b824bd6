import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["firmware_sim.node", "hilscenario.lockstep.run"])
def test_neither_device_nor_scenarios_wait_for_what_only_logs_need(module):
    pytest.importorskip("asammdf")
    code = f"import sys, {module}; sys.exit('asammdf' in sys.modules or 'pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
