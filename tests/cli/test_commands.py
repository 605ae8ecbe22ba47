import subprocess
import sys

from typer.main import get_command

from irbcal.cli import main


def test_what_the_list_says_of_a_command_is_what_it_says_of_itself():
    listed = {name: main._summary(name) for name in main.COMMANDS}
    own = {name: " ".join(c.help.partition("\n\n")[0].split()) for name, c in get_command(main.app).commands.items()}
    assert listed == own


def test_only_the_command_that_is_called_is_loaded():
    def loaded(call):
        done = subprocess.run([sys.executable, "-c", code.format(call)], capture_output=True, text=True, check=True)
        return done.stdout

    code = "from irbcal.cli import main; main.application({}); import sys; print(sorted(m for m in sys.modules if m.startswith('irbcal.cli.')))"
    called = loaded("['fk']")
    assert "'irbcal.cli.use'" in called
    assert "'irbcal.cli.prepare'" not in called
    assert "'irbcal.cli.use'" not in loaded("summary=True")
