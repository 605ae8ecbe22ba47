"""The statements of KRL routines: moves, frames, branches, and every other use of a target."""

from __future__ import annotations

from itertools import pairwise

from irbcal.arrays import FloatArray
from irbcal.correction.course import Course, State
from irbcal.correction.languages.krl.data import POSE, Aggregate, Data, Variable, aggregate, target
from irbcal.correction.languages.krl.tokens import END, Line, names_in
from irbcal.correction.languages.krl.writing import KUKA
from irbcal.correction.listing import Listing
from irbcal.correction.maker_program import Found, frame
from irbcal.correction.text_program import Role
from irbcal.correction.tokens import Token

MOVES = {name.lower(): name for name in ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "SPL")}
RELATIVE = {name.lower(): name for name in ("PTP_REL", "LIN_REL", "CIRC_REL", "SPTP_REL", "SLIN_REL", "SCIRC_REL")}
OPEN = ("if", "switch", "spline", "ptp_spline")
LOOPS = ("for", "while", "repeat", "loop")
ALTERNATIVE = ("else", "case", "default")
CLOSE = ("endif", "endswitch", "endfor", "endwhile", "until", "endloop")
ROUTINE = ("def", "deffct", "defdat", "end", "endfct", "enddat")
NULLFRAME = "0"
KNOWN = ("wait", "continue", "bas", "pulse", "halt", "return", "ini", "user_msg")
TAKES_FDAT = ("#frames", "#ptp_params", "#cp_params")
"""Commands of ``BAS`` that set tool and base from ``FDAT_ACT``."""
NO_FRAMES = (
    "#acc_cp",
    "#acc_glue",
    "#acc_ptp",
    "#vel_cp",
    "#vel_ptp",
    "#cp_dat",
    "#ptp_dat",
    "#group",
    "#out_sync",
    "#out_async",
)
"""Commands of ``BAS`` that leave tool and base."""
FIXED_TOOL = "the tool is fixed and the part on the robot (#TCP)"


class Statements:
    """Follows the lines of routines.

    Parameters
    ----------
    listing : Listing
    data : Data
        With its targets collected.

    Attributes
    ----------
    course : Course
    literals : list of Found
        Targets inside moves.
    tools, frames : dict of str to ndarray, shape (4, 4)
        Of the names that the program gives values to.
    notes : list of (int, str)
    """

    def __init__(self, listing: Listing, data: Data) -> None:
        self.listing, self.data = listing, data
        self.course = Course(listing)
        self.literals: list[Found] = []
        self.tools: dict[str, FloatArray] = {}
        self.frames: dict[str, FloatArray] = {}
        self.notes: list[tuple[int, str]] = []
        self._fdat: State | None = None
        self._fdat_taken = True
        self._before_spline = State()
        self._called = False
        self._mentioned: list[tuple[Token, int]] = []

    def statement(self, line: Line) -> None:
        """Take one line."""
        word = line.word()
        if word in MOVES:
            self._move(line, MOVES[word])
        elif word in RELATIVE:
            self.course.left(line.start, RELATIVE[word], self._rest(line, 1), "its target is relative")
            self.course.stop(None, line.start)
            self._mention(line.tokens[1:], line.part)
        elif word in ROUTINE:
            self.course.restart()
            self._forget_fdat()
        elif word in (*OPEN, *LOOPS):
            self._mention(line.tokens, line.part)
            if word in ("spline", "ptp_spline"):
                self._before_spline = self.course.state
                self._with(line, self.course.state, lasting=True)
            else:
                self.course.open(word in LOOPS)
                self._forget_fdat()
        elif word in ALTERNATIVE:
            self.course.alternative()
            self._forget_fdat()
        elif word in CLOSE:
            self.course.close(line.start)
            self._forget_fdat()
        elif word == "endspline":
            if self.course.state != self._before_spline:
                why = f"the spline block that ends in line {self.listing.line(line.start)} has its own tool or base"
                self.course.state = State(None, None, why)
        elif word in ("goto", "interrupt", "return", "halt") or (line.word(1) == ":" and len(line.tokens) == 2):
            self.course.forget()
            if line.word(1) == ":" and len(line.tokens) == 2:
                self.course.state = State(None, None, f"the label in line {self.listing.line(line.start)} is jumped to")
                self._forget_fdat()
        elif word == "bas" and line.word(1) == "(":
            self._bas(line)
        else:
            self._assignment(line)

    def _bas(self, line: Line) -> None:
        """What ``BAS`` does to tool and base, as KUKA's bas.src has it.

        ``#FRAMES``, ``#PTP_PARAMS`` and ``#CP_PARAMS`` set both from ``FDAT_ACT``; ``#INITMOV`` sets both to what the
        version of the controller says, so that they count as those before the first of the program.
        """
        command, n = line.word(2), line.word(4)
        plain = n if n.isdecimal() and line.word(5) == ")" else None
        where = self.listing.line(line.start)
        computed = f"BAS in line {where} computes the tool or base"
        if command == "#tool":
            self.course.tool(plain, computed)
        elif command == "#base":
            self.course.frame(plain, computed)
        elif command == "#ex_base":
            self.course.frame(None, f"BAS in line {where} ties the base to an external axis")
        elif command in TAKES_FDAT:
            why = f"BAS({command.upper()}) in line {where} takes tool and base from FDAT_ACT, which is not set"
            self.course.state = self._fdat or State(None, None, why)
            self._fdat_taken = True
        elif command == "#initmov":
            self.course.state = State()
        elif command not in NO_FRAMES:
            self.course.state = State(None, None, computed)

    def _forget_fdat(self) -> None:
        """``FDAT_ACT`` may have another value from here on."""
        self._fdat, self._fdat_taken = None, True

    def _checked_fdat(self, state: State) -> State:
        """Tool and base of a move; unknown where ``FDAT_ACT`` names others and no ``BAS`` has taken it."""
        fdat = self._fdat
        if fdat is None or self._fdat_taken or (fdat.tool, fdat.frame) == (state.tool, state.frame):
            return state
        names = f"tool {fdat.tool} and base {fdat.frame}"
        return State(None, None, fdat.why or f"FDAT_ACT names {names}, but no BAS sets them before the move")

    def _of_fdat(self, part: int, name: str) -> State:
        """Tool and base of the frame data of an inline form."""
        variable = self.data.lookup(part, name)
        if variable is None or len(variable.entries) != 1 or variable.changes:
            return State(None, None, f"the frame data {name.upper()} are not in these files")
        return self._of_frame_data(variable.entries[0][1], name.upper())

    def _of_frame_data(self, data: Aggregate, name: str) -> State:
        values = data.values
        numbers = [values[key].number for key in ("tool_no", "base_no") if key in values]
        if "ipo_frame" in values and values["ipo_frame"].text.strip().lower() != "#base":
            return State(None, None, f"{name} says that {FIXED_TOOL}")
        plain = [str(int(number.value)) for number in numbers if number is not None and number.value % 1 == 0]
        if len(plain) < 2:
            return State(None, None, f"the frame data {name} name no tool or base")
        return State(*plain)

    def _set_fdat(self, line: Line) -> None:
        """A value of ``FDAT_ACT``: frame data by their name, or in braces."""
        self._fdat_taken = False
        in_braces = aggregate(line, self.listing)
        if in_braces is not None:
            self._fdat = self._of_frame_data(in_braces, f"in line {self.listing.line(line.start)}")
        elif line.next.kind == "name" and line.at + 1 == len(line.tokens):
            self._fdat = self._of_fdat(line.part, line.word())
        else:
            self._fdat = State(None, None, f"FDAT_ACT is computed in line {self.listing.line(line.start)}")

    def _assignment(self, line: Line) -> None:
        """An assignment, or any other statement."""
        tokens = line.tokens
        first = line.next
        if first.kind != "name":
            self._mention(tokens, line.part)
            return
        line.at = 1
        index = line.index()
        member = line.word() == "."
        if not member and line.take("="):
            self._assigned(line, first, index)
            return
        variable = self.data.lookup(line.part, first.word)
        if member and first.word == "fdat_act":
            self._fdat = State(None, None, f"a part of FDAT_ACT is set in line {self.listing.line(line.start)}")
            self._fdat_taken = False
            return
        if member and variable is not None and line.word(2) == "=":
            variable.changes.append(first.start)
            self._mention(tokens[line.at :], line.part)
            return
        self._mention(tokens, line.part)
        if line.word() == "(" or len(tokens) == 1:
            self.course.forget()
            if first.word not in KNOWN and not self._called:
                self._called = True
                name = self.listing.quote(first.start, first.end)
                self.notes.append((first.start, f"{name} is called: it is not followed, and may set tool or base"))

    def _assigned(self, line: Line, first: Token, index: tuple[int, ...] | None) -> None:
        word = first.word
        if word in ("$tool", "$base"):
            name = self._frame_value(line, word == "$tool")
            why = f"{word.upper()} is computed in line {self.listing.line(first.start)}"
            (self.course.tool if word == "$tool" else self.course.frame)(name, why)
            return
        if word == "$ipo_mode":
            if any(token.word == "#tcp" for token in line.tokens):
                self.course.state = State(None, None, FIXED_TOOL)
            return
        if word == "fdat_act":
            self._set_fdat(line)
            return
        if word in ("tool_data", "base_data") and index:
            one = aggregate(line, self.listing)
            numbers = [one.values[key].number for key in POSE if key in one.values] if one is not None else []
            plain = [number.value for number in numbers if number is not None]
            frames = self.tools if word == "tool_data" else self.frames
            if len(plain) == 6:
                frames[str(index[0])] = frame(KUKA, plain)
            return
        variable = self.data.lookup(line.part, word)
        if variable is not None:
            begin = line.at
            self.data.value(variable, index, line)
            if variable.changes:
                self._mention(line.tokens[begin:], line.part)
        else:
            self._mention(line.tokens[line.at :], line.part)

    def _frame_value(self, line: Line, tool: bool) -> str | None:
        """Name of the frame that is assigned to ``$TOOL`` or ``$BASE``; None where it is computed."""
        frames = self.tools if tool else self.frames
        at, part = line.next.start, line.part
        one = aggregate(line, self.listing)
        if one is not None:
            numbers = [one.values[key].number for key in POSE if key in one.values]
            plain = [number.value for number in numbers if number is not None]
            if len(plain) < 6 or line.word() not in ("", ","):
                return None
            name = f"of line {self.listing.line(at)}, column {self.listing.column(at)}"
            frames[name] = frame(KUKA, plain)
            return name
        word = line.word()
        if line.next.kind != "name":
            return None
        line.at += 1
        if word in ("stool2", "sbase") and line.take("("):
            name = line.word()
            depth = 1
            while depth and line.next is not END:
                depth += (line.word() == "(") - (line.word() == ")")
                line.at += 1
            state = self._of_fdat(part, name)
            return state.tool if tool else state.frame
        index = line.index()
        if line.word() not in ("", ",", "c_spl", "c_ptp", "c_dis", "c_vel", "c_ori") or index is None:
            return None
        if word in ("$nullframe", "$world"):
            return NULLFRAME
        if word in ("tool_data", "base_data"):
            return str(index[0]) if len(index) == 1 and (word == "tool_data") is tool else None
        return self._variable_frame(part, word, index, frames)

    def _variable_frame(
        self, part: int, word: str, index: tuple[int, ...], frames: dict[str, FloatArray]
    ) -> str | None:
        variable = self.data.lookup(part, word)
        if variable is None:
            return word
        found = variable.found.get(index)
        if found is None or variable.changes or len(variable.entries) != len(variable.found):
            return None
        frames[word + str(index or "")] = frame(KUKA, [number.value for number in found.numbers])
        return word + str(index or "")

    def _with(self, line: Line, state: State, lasting: bool = False) -> State:
        """Tool and base that ``WITH`` gives a move."""
        tokens = line.tokens
        for k, (token, behind) in enumerate(pairwise(tokens)):
            if token.word in ("$tool", "$base", "$ipo_mode") and behind.word == "=":
                line.at = k + 2
                if token.word == "$ipo_mode":
                    fixed = any(name.word == "#tcp" for name in tokens[k:])
                    state = State(None, None, FIXED_TOOL) if fixed else state
                    continue
                name = self._frame_value(line, token.word == "$tool")
                why = f"{token.word.upper()} is computed in line {self.listing.line(token.start)}"
                new = (name, state.frame) if token.word == "$tool" else (state.tool, name)
                state = State(*new, why if None in new else state.why)
        if lasting:
            self.course.state = state
        return state

    def _move(self, line: Line, name: str) -> None:
        """The points of a move."""
        ends = [k for k, token in enumerate(line.tokens) if token.word == "with"]
        state = self._checked_fdat(self.course.state)
        state = self._with(line, state) if ends else state
        line.at = 1
        roles: tuple[Role, ...] = ("via", "to") if name in ("CIRC", "SCIRC") else ("to",)
        goal: Found | None = None
        for k, role in enumerate(roles):
            if k and not line.take(","):
                self.course.left(line.start, name, self._rest(line, 1), "its end point is missing")
                break
            found, text, reason = self._point(line, name)
            if reason:
                self.course.left(line.start, name, text, reason)
            for one in found:
                self.course.use(one, line.start, name, role, state)
                if reason:
                    one.reasons.append(reason)
            goal = found[0] if len(found) == 1 and not reason else None
        self.course.stop(goal, line.start)
        rest = [token for token in line.tokens[line.at :] if token.kind == "name" and token.word[:1] != "$"]
        self._mention([token for token in rest if not token.word.startswith("c_")], line.part)

    def _point(self, line: Line, move: str) -> tuple[list[Found], str, str]:
        """Targets that an argument stands for, its text, and why they are not all or not to be changed."""
        begin = line.at
        one = aggregate(line, self.listing)
        if one is not None and line.word() != ":":
            name = f"of {move} in line {self.listing.line(one.start)}"
            found, reason = target(name, "", one, self.listing)
            text = self.listing.quote(one.start, one.end)
            if found is None:
                return [], text, reason
            self.literals.append(found)
            return [found], text, ""
        line.at = begin
        token = line.next
        if token.kind != "name":
            return [], self._rest(line, begin), "its target is computed"
        line.at += 1
        index = line.index()
        text = self._rest(line, begin, line.at)
        if line.word() in (":", ".", "(", "+", "-"):
            self._mention(line.tokens[begin:], line.part)
            line.at = len(line.tokens)
            return [], self._rest(line, begin), "its target is computed"
        variable = self.data.lookup(line.part, token.word)
        if variable is None:
            return [], text, f"{text} is not declared in these files"
        if self.data.stems[variable.part].startswith("$"):
            self.notes.append((token.start, f"{text} stands in a file that other programs share: it is left as it was"))
            return [], "", ""
        return self._of_variable(variable, index, text)

    def _of_variable(
        self, variable: Variable, index: tuple[int, ...] | None, text: str
    ) -> tuple[list[Found], str, str]:
        found = [one for at, one in variable.found.items() if index is None or at == index]
        if variable.changes:
            line = self.listing.line(variable.changes[0])
            return found, text, f"{text} is computed, changed or not whole in line {line}"
        if not found:
            return [], text, f"{text} has no value in these files"
        return found, text, ""

    def _mention(self, tokens: list[Token], part: int) -> None:
        """Note names that are used in another way than as the target of a move."""
        self._mentioned += [(token, part) for token in names_in(tokens)]

    def conclude(self) -> None:
        """Tell the targets where they are used in another way than as the target of a move."""
        for token, part in self._mentioned:
            variable = self.data.lookup(part, token.word)
            for found in variable.found.values() if variable is not None else ():
                found.reasons.append(f"line {self.listing.line(token.start)} uses it in another way")

    def _rest(self, line: Line, begin: int, end: int | None = None) -> str:
        tokens = line.tokens[begin:end]
        return self.listing.quote(tokens[0].start, tokens[-1].end) if tokens else ""
