"""The loop of live correction, and the command."""

import gc
import io
import json

from irbcal.exporting.live_correction import LONGEST_LINE, Latencies, Live, run


def test_every_line_has_an_answer_and_the_end_tells_how_long(sources):
    live, out, told = Live(sources["plain"], at=[0, 0, 0, 0, 10, 0]), io.BytesIO(), []
    lines = b'{"joints": [0, 0, 0, 0, 10, 0]}\n' + b"x" * (3 * LONGEST_LINE) + b'\n{"joints": [0, 0, 0, 0, 10.1, 0]}'
    run(live, io.BytesIO(lines), out, told.append)
    held = [json.loads(line)["held"] for line in out.getvalue().splitlines()]
    assert held == [False, True, False]
    assert told[0].startswith("3 lines, 1 held; a line took ")
    assert gc.isenabled()


def test_stopping_is_no_error(sources):
    class Stopped(io.BytesIO):
        def readline(self, size=-1):
            raise KeyboardInterrupt

    told = []
    run(Live(sources["plain"]), Stopped(), io.BytesIO(), told.append)
    assert told == ["no lines"]


def test_quantiles():
    latencies = Latencies()
    for us in range(1000):
        latencies.add(1000 * us + 5)
    latencies.add(10**12)
    assert (latencies.quantile(0.5), latencies.quantile(0.999)) == (501, 1000)
    assert latencies.longest_ns == 10**12


def test_the_command(folder, tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from irbcal.cli.main import app

    lines = '{"joints": [0, -14, 14, 0, 30, 0], "id": 1}\n'
    done = CliRunner().invoke(app, ["stream", str(folder), "--at", "0,-14,14,0,30,0"], input=lines)
    assert done.exit_code == 0
    assert json.loads(done.stdout)["id"] == 1
    assert "99.9th percentile" in done.stderr
    done = CliRunner().invoke(app, ["stream", str(folder)], input=lines)
    assert "the first line needs at" in json.loads(done.stdout)["why"]
