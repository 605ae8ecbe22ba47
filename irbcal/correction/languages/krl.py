"""KUKA KRL programs: a routine's ``.src`` with the ``.dat`` of the same name, and ``$config.dat`` where it is given.

Targets are values in numbers of ``E6POS``, ``POS``, ``E6AXIS``, ``AXIS`` and ``FRAME``, in declarations, in assignments
and inside moves. Where a component is missing the value before stays, so that such a target has no pose of its own.
"""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.backup import Backup, files_named, folders_named, placed, text_of
from irbcal.correction.calls import Calls
from irbcal.correction.control_flow import ControlFlow, FrameState
from irbcal.correction.instructions import TARGETS, VIA, MotionInstruction, built_in, teaching_routine
from irbcal.correction.language import TO_99, FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.languages.krl_reader import (
    ALTERNATIVE,
    CLOSE,
    END,
    EVENTS,
    KUKA,
    LOAD_DATA,
    LOOPS,
    OPEN,
    POSE,
    ROUTINE,
    TYPES,
    Aggregate,
    KrlData,
    PointedTargets,
    TokenLine,
    Variable,
    aggregate,
    inline_forms,
    integer,
    lines_of,
    load,
    names_in,
    posture_of,
    target,
)
from irbcal.correction.listing import Edit, Listing, Span, Token
from irbcal.correction.loads import Load, Ways, unknown_load
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.moves import Moves, note
from irbcal.correction.program import ControllerSetup, Note, Program, each_read, read_bytes
from irbcal.correction.targets import Configuration, Role, Shift, Target
from irbcal.correction.text_program import ON_EXTERNAL_AXES, PostureProgram
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import MM

_STATUS = 7


def like(old: str, value: int) -> str:
    """A whole number in the form of another one."""
    if old[:2].upper() == "'B":
        return f"{old[:2]}{value:0{len(old) - 3}b}'"
    if old[:2].upper() == "'H":
        return f"{old[:2]}{value:0{len(old) - 3}X}'"
    return str(value)


@dataclass(frozen=True, eq=False, repr=False)
class KrlProgram(PostureProgram):
    """A KRL program as read."""

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment line."""
        newline = self.listing.newline(self.listing.file_at(at))
        return at, at, f"; irbcal: fake targets, calibration {fingerprint}{newline}"

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """S and T of joints."""
        turn = sum(1 << k for k in range(6) if joints[k] < 0)
        return posture_of(int(back) | (0 if bent else 2), turn)

    def configuration_edits(self, target: Target, configuration: Configuration) -> list[Edit]:
        """New text of S and T; upper bits of S stay."""
        assert isinstance(configuration, Posture)
        out: list[Edit] = []
        for k, (start, end) in enumerate(target.configuration_spans):
            old = self.text[start:end]
            value = integer(old) or 0
            if k == 0:
                wrist = 4 if (configuration.wrist or 0) < 0 else 0
                new = (value & ~_STATUS) | (1 if configuration.rear else 0) | (0 if configuration.bent else 2) | wrist
            else:
                new = (value & ~0b111111) | sum(1 << i for i in range(6) if configuration.high[i] == 0.0)
            if new != value:
                out.append((start, end, like(old, new)))
        return out

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """Components in braces in the move."""
        assert target.split is not None
        components = [
            f"{name.upper()} {text}" for name, text in zip(POSE, self.split_texts(target, numbers), strict=True)
        ]
        components += [
            f"{name} {text}" for name, text in zip("ST", self.split_configuration(target, configuration), strict=False)
        ]
        components += [f"{name.upper()} {value!r}" for name, value in sorted(target.e.items())]
        return [(*target.split.span, "{" + ",".join(components) + "}")]


MOTIONS = built_in(
    """
    PTP LIN: to
    CIRC: via to
    SPTP SLIN: to
    SCIRC: via to
    SPL: to
    """
)
RELATIVE = {name.lower(): name for name in ("PTP_REL", "LIN_REL", "CIRC_REL", "SPTP_REL", "SLIN_REL", "SCIRC_REL")}
_HOME = re.compile(r"xhome\d*|\$h_pos|\$axis_home")
"""Joint targets that stand in the controller's ``$config.dat`` and ``$machine.dat`` and serve all of its programs."""
NULLFRAME = "0"
_BUILT_IN = (
    "wait continue pulse halt brake return ini user_msg set_cd_params exit abs sqrt sin cos tan acos atan2 b_and "
    "b_or b_exor b_not inv_pos inverse forward varstate cast_from cast_to stradd strclear strcopy strcomp strlen "
    "strfind strdecllen strtoint strtoreal strtobool strtoframe strtopos inttostr swrite sread cwrite cread copen "
    "cclose cioctl fopen fclose set_krlmsg set_krldlg clear_krlmsg clear_krldlg exists_krlmsg exists_krldlg "
    "msgnotify msgquit msgdialog msgloop setinfo clear_kcpmsg on_error_proceed err_raise get_sig_inf "
    "get_decl_place getcyclicgetline timer_limit rob_timer delete_backward_buffer eb_test svel_joint svel_cp "
    "stool2 sbase sipo_mode sload sacc_joint sacc_cp sapo sapo_ptp sgear_jerk sjerk sori_typ use_cm_pro_values "
    "eki_init eki_open eki_close eki_send eki_clear eki_lock eki_unlock eki_checkbuffer eki_getint eki_getreal "
    "eki_getbool eki_getstring eki_getframe eki_getintarray eki_getrealarray eki_getboolarray"
)
BUILT_IN = frozenset(_BUILT_IN.split())
"""Instructions and functions of the controller's own that move nothing and leave tool and base."""
TAKES_FDAT = ("#frames", "#ptp_params", "#cp_params")
"""Commands of ``BAS`` that set tool and base from ``FDAT_ACT``."""
_WITHOUT_FRAMES = "#acc_cp #acc_glue #acc_ptp #vel_cp #vel_ptp #cp_dat #ptp_dat #group #out_sync #out_async"
NO_FRAMES = frozenset(_WITHOUT_FRAMES.split())
"""Commands of ``BAS`` that leave tool and base."""
QUIET_BAS = [[command] for command in NO_FRAMES]
NUMBERED, ANY = ("tool_data", "base_data"), ""
SETS_FRAMES = ("$tool", "$base", "$ipo_mode", "fdat_act", *NUMBERED)
"""What a routine says that may set tool or base, beside commands of ``BAS``."""
FIXED_TOOL = "the tool is fixed and the part on the robot (#TCP)"


class Statements:
    """Follows the lines of routines.

    Parameters
    ----------
    listing : Listing
    data : KrlData
        With its targets collected.
    ignored_calls : sequence of str
        Patterns of names of routines that neither move the arm nor set tool or base.
    split_points : bool
        Whether shifted targets become targets of their own.
    taught : dict of str to MotionInstruction
        Routines that move to one of their arguments.
    """

    def __init__(
        self,
        listing: Listing,
        data: KrlData,
        ignored_calls: Sequence[str] = (),
        split_points: bool = False,
        taught: Mapping[str, MotionInstruction] = MappingProxyType({}),
    ) -> None:
        self.listing, self.data, self.taught = listing, data, taught
        self.flow = ControlFlow(listing, Calls(ignored_calls, BUILT_IN), split_points=split_points)
        self._forms = inline_forms(listing)
        self._called_in_form: tuple[Span, str, Ways] | None = None
        self._loads: dict[str, Load | None] = {}
        for assignment in LOAD_DATA.finditer(listing.text):
            value = load(assignment[2])
            if self._loads.setdefault(assignment[1], value) != value:
                self._loads[assignment[1]] = unknown_load(
                    f"line {listing.line(assignment.start())} changes LOAD_DATA[{assignment[1]}]"
                )
        self.flow.first_begins = True
        self.literals: list[Target] = []
        """Targets inside moves."""
        self.tools: dict[str, FloatArray] = {}
        self.frames: dict[str, FloatArray] = {}
        """Values of shape (4, 4). Of the names that the program gives values to."""
        self.notes: list[tuple[int, str]] = []
        self._fdat: FrameState | None = None
        self._fdat_taken, self._fdat_at = True, -1
        self._before_spline = FrameState()
        self._changed: dict[tuple[str, str], int] = {}
        self._mentioned: list[tuple[Token, int]] = []

    def follow(self, lines: Iterable[TokenLine]) -> None:
        """Learn which routines set tool or base, which move, and what they call."""
        name = ""
        for statement in lines:
            keywords = [token.word for token in statement.tokens]
            if "def" in keywords[:2] or "deffct" in keywords[:3]:
                name = statement.routine
                self.flow.calls.learn(name)
            else:
                sets = not {*keywords}.isdisjoint(SETS_FRAMES) or (
                    keywords[:1] == ["bas"] and keywords[2:3] not in QUIET_BAS
                )
                moves = keywords[0] in MOTIONS or keywords[0] in RELATIVE or keywords[0] in self.taught
                called = [token.word for token in statement.called_routines if token.word not in self.taught]
                self.flow.calls.learn(
                    name, called, sets, moves, "$load" in keywords or (sets and any(self._loads.values()))
                )

    def _call(self, routine: Token) -> None:
        """A routine is called. In an inline form tool and base are those of the form until it ends."""
        form = self._form_of(routine.start)
        state, carried = self.flow.state, self.flow.loads.now
        self.flow.call(routine.word, self.listing.text[routine.start : routine.end], routine.start)
        if self.flow.state is state:
            return
        if form is not None and self._fdat_taken and self._fdat_at > form[0]:
            self._called_in_form = self._called_in_form or (form, self.flow.state.reason, self.flow.loads.now)
            self.flow.state, self.flow.loads.now = state, carried
        else:
            self._forget_fdat()

    def _form_of(self, at: int) -> Span | None:
        """The inline form in which a place lies."""
        k = bisect.bisect_right(self._forms, (at, len(self.listing.text))) - 1
        start, end = self._forms[k] if k >= 0 else (0, 0)
        return (start, end) if start <= at < end else None

    def statement(self, statement: TokenLine) -> None:
        """Take one line."""
        statement.take("global")
        word = statement.word()
        if self._called_in_form is not None and statement.start >= self._called_in_form[0][1]:
            self.flow.state = FrameState(None, None, self._called_in_form[1])
            self.flow.loads.now = self._called_in_form[2]
            self._forget_fdat()
            self._called_in_form = None
        if word in self.taught and statement.word(1) == "(":
            self._taught_move(statement, self.taught[word])
            return
        if word not in ROUTINE:
            for routine in statement.called_routines:
                self._call(routine)
        if word in EVENTS:
            for routine, bracket in pairwise(statement.tokens):
                if bracket.word == "(":
                    self.flow.call_any_time(routine.word)
        if word in MOTIONS:
            self._move(statement, MOTIONS[word])
        elif word in ("lin_rel", "slin_rel") and self._relative(statement, RELATIVE[word]):
            pass
        elif word in RELATIVE:
            self.flow.leave(statement.start, RELATIVE[word], self._rest(statement, 1), "its target is relative")
            self.flow.stop(None, statement.start)
            self._mention(statement.tokens[1:], statement.file)
        elif word in ROUTINE:
            self.flow.restart(statement.routine)
            self._forget_fdat()
        elif word in (*OPEN, *LOOPS):
            self._mention(statement.tokens, statement.file)
            if word in ("spline", "ptp_spline"):
                self._before_spline = self.flow.state
                self._with(statement, self.flow.state, lasting=True)
            else:
                self.flow.open(word in LOOPS)
                self._forget_fdat()
        elif word in ALTERNATIVE:
            self.flow.alternative()
            self._forget_fdat()
        elif word in CLOSE:
            self.flow.close(statement.start)
            self._forget_fdat()
        elif word == "endspline":
            if self.flow.state != self._before_spline:
                reason = (
                    f"the spline block that ends in line {self.listing.line(statement.start)} has its own tool or base"
                )
                self.flow.state = FrameState(None, None, reason)
        elif word == "interrupt" and not self.flow.stops:  # declared and switched on before anything moves
            self._mention(statement.tokens, statement.file)
        elif statement.word(1) == ":" and len(statement.tokens) == 2:
            self.flow.label(statement.start)
            self._forget_fdat()
        elif word in ("goto", "interrupt", "return", "halt"):
            self.flow.forget()
            if word in ("return", "halt"):
                self.flow.loads.returns()
            elif word != "interrupt":
                self.flow.loads.label()
        elif word == "bas" and statement.word(1) == "(":
            self._bas(statement)
        else:
            self._assignment(statement)

    def _bas(self, statement: TokenLine) -> None:
        """What ``BAS`` does to tool and base, as KUKA's bas.src has it.

        ``#FRAMES``, ``#PTP_PARAMS`` and ``#CP_PARAMS`` set both from ``FDAT_ACT``; ``#INITMOV`` sets both to what the
        version of the controller says, so that they count as those before the first of the program.
        """
        command, n = statement.word(2), statement.word(4)
        plain = n if n.isdecimal() and statement.word(5) == ")" else None
        where = self.listing.line(statement.start)
        computed = f"BAS in line {where} computes the tool or base"
        if command == "#tool":
            self.flow.tool(plain, computed)
            self._carry_tool(plain, statement.start)
        elif command == "#base":
            self.flow.frame(plain, computed)
        elif command == "#ex_base":
            name = None if plain is None else f"{ON_EXTERNAL_AXES}{plain}"
            self.flow.frame(name, f"BAS in line {where} ties the base to an external axis")
        elif command in TAKES_FDAT:
            reason = f"BAS({command.upper()}) in line {where} takes tool and base from FDAT_ACT, which is not set"
            self.flow.state = self._fdat or FrameState(None, None, reason)
            self._fdat_taken = True
            self._carry_tool(self.flow.state.tool, statement.start)
        elif command == "#initmov":
            self.flow.state = FrameState()
        elif command not in NO_FRAMES:
            self.flow.state = FrameState(None, None, computed)

    def _carry_tool(self, number: str | None, at: int) -> None:
        """The load of a tool, which ``BAS`` sets with it, where the files have loads of tools."""
        if any(self._loads.values()):
            self.flow.carry(self._load_of_tool(number), at)

    def _load_of_tool(self, number: str | None) -> Load | None:
        """``LOAD_DATA`` of a tool."""
        if number is None or not (number.isdecimal() and (number == NULLFRAME or number in self._loads)):
            return unknown_load(f"LOAD_DATA[{number or '…'}] is not in these files")
        return self._loads.get(number)

    def _load_value(self, statement: TokenLine) -> Load | None:
        """The load that is assigned to ``$LOAD``, of which the value comes next."""
        word, start = statement.word(), statement.next.start
        if word == "{":
            return load(self.listing.text[start : statement.end])
        if word == "load_data":
            return self._load_of_tool(statement.word(2) if statement.word(3) == "]" else None)
        if word == "sload" and statement.word(1) == "(":
            return self._load_of_tool(self._of_fdat(statement.file, statement.word(2)).tool)
        return unknown_load(f"$LOAD is computed in line {self.listing.line(start)}")

    def _forget_fdat(self) -> None:
        """``FDAT_ACT`` may have another value from here on."""
        self._fdat, self._fdat_taken, self._fdat_at = None, True, -1

    def _checked_fdat(self, state: FrameState) -> FrameState:
        """Tool and base of a move; unknown where ``FDAT_ACT`` names others and no ``BAS`` has taken it."""
        fdat = self._fdat
        same = fdat is not None and (fdat.tool, fdat.frame, fdat.part_on_robot) == (
            state.tool,
            state.frame,
            state.part_on_robot,
        )
        if fdat is None or self._fdat_taken or same:
            return state
        names = f"tool {fdat.tool} and base {fdat.frame}"
        return FrameState(None, None, fdat.reason or f"FDAT_ACT names {names}, but no BAS sets them before the move")

    def _of_fdat(self, file: int, name: str) -> FrameState:
        """Tool and base of the frame data of an inline form."""
        variable = self.data.lookup(file, name)
        if variable is None or len(variable.entries) != 1 or variable.changes:
            return FrameState(None, None, f"the frame data {name.upper()} are not in these files")
        return self._of_frame_data(variable.entries[0][1], name.upper())

    def _of_frame_data(self, data: Aggregate, name: str) -> FrameState:
        values = data.values
        numbers = [values[key].number for key in ("tool_no", "base_no") if key in values]
        mode = values["ipo_frame"].text.strip().lower() if "ipo_frame" in values else "#base"
        if mode not in ("#base", "#tcp"):
            return FrameState(None, None, f"{name} does not say in a word whether {FIXED_TOOL}")
        plain = [str(int(number.value)) for number in numbers if number is not None and number.value % 1 == 0]
        if len(plain) < 2:
            return FrameState(None, None, f"the frame data {name} name no tool or base")
        return FrameState(plain[0], plain[1], part_on_robot=mode == "#tcp")

    def _set_fdat(self, statement: TokenLine) -> None:
        """A value of ``FDAT_ACT``: frame data by their name, or in braces."""
        self._fdat_taken, self._fdat_at = False, statement.start
        in_braces = aggregate(statement, self.listing)
        if in_braces is not None:
            self._fdat = self._of_frame_data(in_braces, f"in line {self.listing.line(statement.start)}")
        elif statement.next.kind == "name" and statement.at + 1 == len(statement.tokens):
            self._fdat = self._of_fdat(statement.file, statement.word())
        else:
            self._fdat = FrameState(None, None, f"FDAT_ACT is computed in line {self.listing.line(statement.start)}")

    def _assignment(self, statement: TokenLine) -> None:
        """An assignment, or any other statement."""
        tokens = statement.tokens
        first = statement.next
        if first.kind != "name":
            self._mention(tokens, statement.file)
            return
        statement.at = 1
        index = statement.index()
        member = statement.word() == "."
        if not member and statement.take("="):
            self._assigned(statement, first, index)
            return
        variable = self.data.lookup(statement.file, first.word)
        if statement.word() == "(":
            variables = [self.data.lookup(statement.file, each.word()) for each in statement.arguments]
            name = self.listing.text[first.start : first.end]
            text = teaching_routine("krl", name, [bool(v is not None and v.targets) for v in variables])
            self.flow.teaching[self.listing.line(first.start)] = text
        if member and first.word == "fdat_act":
            self._fdat = FrameState(
                None, None, f"a part of FDAT_ACT is set in line {self.listing.line(statement.start)}"
            )
            self._fdat_taken = False
            return
        if member and first.word in ("$tool", "$base"):
            reason = f"a part of {first.word.upper()} is set in line {self.listing.line(first.start)}"
            (self.flow.tool if first.word == "$tool" else self.flow.frame)(None, reason)
            return
        if member and first.word == "$load":
            where = f"a part of $LOAD is set in line {self.listing.line(first.start)}"
            usual = statement.word(2) == "=" and statement.word(3).startswith("$def_l_")
            self.flow.carry(None if usual else unknown_load(where), first.start)
            return
        if first.word in NUMBERED:
            self._changed[first.word, str(index[0]) if index else ANY] = first.start
            return
        if member and variable is not None and statement.word(2) == "=":
            variable.changes.append(first.start)
            self._mention(tokens[statement.at :], statement.file)
            return
        self._mention(tokens, statement.file)

    def _assigned(self, statement: TokenLine, first: Token, index: tuple[int, ...] | None) -> None:
        word = first.word
        if word in ("$tool", "$base"):
            name = self._frame_value(statement, word == "$tool")
            reason = f"{word.upper()} is computed in line {self.listing.line(first.start)}"
            (self.flow.tool if word == "$tool" else self.flow.frame)(name, reason)
            return
        if word == "$ipo_mode":
            self._hold(self._with_mode(self.flow.state, statement))
            return
        if word == "$load":
            self.flow.carry(self._load_value(statement), first.start)
            return
        if word == "fdat_act":
            self._set_fdat(statement)
            return
        if word in NUMBERED:
            number = str(index[0]) if index else ANY
            braces = aggregate(statement, self.listing)
            frames = self.tools if word == "tool_data" else self.frames
            frame = None if braces is None else braces.frame()
            if frame is None or number == ANY or not np.array_equal(frames.setdefault(number, frame), frame):
                self._changed[word, number] = first.start
            return
        variable = self.data.lookup(statement.file, word)
        if variable is not None:
            begin = statement.at
            self.data.value(variable, index, statement)
            if variable.changes:
                self._mention(statement.tokens[begin:], statement.file)
        else:
            self._mention(statement.tokens[statement.at :], statement.file)

    def _frame_value(self, statement: TokenLine, tool: bool) -> str | None:
        """Name of the frame that is assigned to ``$TOOL`` or ``$BASE``; None where it is computed."""
        frames = self.tools if tool else self.frames
        at, file = statement.next.start, statement.file
        braces = aggregate(statement, self.listing)
        if braces is not None:
            frame = braces.frame()
            if frame is None or statement.word() not in ("", ","):
                return None
            name = f"of line {self.listing.line(at)}, column {self.listing.column(at)}"
            frames[name] = frame
            return name
        word = statement.word()
        if statement.next.kind != "name":
            return None
        statement.at += 1
        if word in ("stool2", "sbase") and statement.take("("):
            name = statement.word()
            depth = 1
            while depth and statement.next is not END:
                depth += (statement.word() == "(") - (statement.word() == ")")
                statement.at += 1
            state = self._of_fdat(file, name)
            return state.tool if tool else state.frame
        index = statement.index()
        if statement.word() not in ("", ",", "c_spl", "c_ptp", "c_dis", "c_vel", "c_ori") or index is None:
            return None
        if word in ("$nullframe", "$world"):
            return NULLFRAME
        if word in ("tool_data", "base_data"):
            return str(index[0]) if len(index) == 1 and (word == "tool_data") is tool else None
        return self._variable_frame(file, word, index, frames)

    def _variable_frame(
        self, file: int, word: str, index: tuple[int, ...], frames: dict[str, FloatArray]
    ) -> str | None:
        variable = self.data.lookup(file, word)
        if variable is None:
            return word
        frame_target = variable.targets.get(index)
        if frame_target is None or variable.changes or len(variable.entries) != len(variable.targets):
            return None
        frames[word + str(index or "")] = KUKA.frame([number.value for number in frame_target.numbers])
        return word + str(index or "")

    def _with(self, statement: TokenLine, state: FrameState, lasting: bool = False) -> FrameState:
        """Tool and base that ``WITH`` gives a move."""
        tokens = statement.tokens
        for k, (token, behind) in enumerate(pairwise(tokens)):
            if token.word in ("$tool", "$base", "$ipo_mode") and behind.word == "=":
                statement.at = k + 2
                if token.word == "$ipo_mode":
                    state = self._with_mode(state, statement)
                    if lasting:
                        self._hold(state)
                    continue
                name = self._frame_value(statement, token.word == "$tool")
                reason = f"{token.word.upper()} is computed in line {self.listing.line(token.start)}"
                new = (name, state.frame) if token.word == "$tool" else (state.tool, name)
                state = FrameState(*new, reason if None in new else state.reason, state.part_on_robot)
                if lasting:
                    (self.flow.tool if token.word == "$tool" else self.flow.frame)(name, "" if name else reason)
        return state

    def _carried_with(self, statement: TokenLine) -> Ways | None:
        """The load that ``WITH`` gives a move; None where it gives none."""
        for k, (token, behind) in enumerate(pairwise(statement.tokens)):
            if token.word == "$load" and behind.word == "=":
                statement.at = k + 2
                self.flow.names_loads.append(token.start)
                self.flow.loads.names_any = True
                return frozenset([self._load_value(statement)])
        return None

    def _hold(self, state: FrameState) -> None:
        """Take from a state, beside which tool and frame stay, whether the robot holds the part, if that is known."""
        if state.tool is state.frame is None:
            self.flow.state = state
        else:
            self.flow.hold(state.part_on_robot)

    def _with_mode(self, state: FrameState, statement: TokenLine) -> FrameState:
        """Tool and base with the value of ``$IPO_MODE`` that comes next, in a word or as frame data have it."""
        if statement.word() == "sipo_mode":
            form = self._of_fdat(statement.file, statement.word(2))
            return form if form.tool is None else replace(state, part_on_robot=form.part_on_robot)
        if statement.word() in ("#base", "#tcp"):
            return replace(state, part_on_robot=statement.word() == "#tcp")
        return FrameState(None, None, f"$IPO_MODE is computed: it is not known whether {FIXED_TOOL}")

    def _taught_move(self, statement: TokenLine, instruction: MotionInstruction) -> None:
        """A routine that moves to one of its arguments."""
        arguments = statement.arguments
        roles = instruction.roles(len(arguments), False)
        if roles is None:
            self.flow.leave(statement.start, instruction.name, "", instruction.refusal(len(arguments)))
        goal: Target | None = None
        for role, argument in zip(roles or [""] * len(arguments), arguments, strict=True):
            if role in TARGETS:
                pointed, state = self._point(argument, instruction.name), self._checked_fdat(self.flow.state)
                goal = self._use(pointed, statement.start, instruction.name, "via" if role == VIA else "to", state)
            else:
                self._mention(argument.tokens, statement.file)
        self.flow.stop(goal, statement.start)

    def _use(
        self, pointed: PointedTargets, at: int, name: str, role: Role, state: FrameState, *more: Any
    ) -> Target | None:
        """Use what a point stands for, as `ControlFlow.use`; the target where it is one."""
        targets, text, reason = pointed
        if reason:
            self.flow.leave(at, name, text, reason)
        for goal in targets:
            self.flow.use(goal, at, name, role, state, *more)
            goal.conflicts += [reason] if reason else []
        return targets[0] if len(targets) == 1 and not reason else None

    def _move(self, statement: TokenLine, instruction: MotionInstruction) -> None:
        """The points of a move."""
        name = instruction.name
        ends = [k for k, token in enumerate(statement.tokens) if token.word == "with"]
        state = self._checked_fdat(self.flow.state)
        state = self._with(statement, state) if ends else state
        carried = self._carried_with(statement) if ends else None
        statement.at = 1
        if statement.word() in ("$axis_act", "$pos_act") and not ends:  # to where the arm stands
            return
        words = [token.word for token in statement.tokens]
        goal: Target | None = None
        for k, word in enumerate(instruction.required):
            role: Role = "via" if word == VIA else "to"
            if k and not statement.take(","):
                self.flow.leave(statement.start, name, self._rest(statement, 1), "its end point is missing")
                break
            shifted = self._shifted(statement, name, state)
            if shifted == []:
                goal = None
                continue
            pointed = (shifted, "", "") if shifted else self._point(statement, name)
            goal = self._use(pointed, statement.start, name, role, state, ("$tool" in words, "$base" in words), carried)
        self.flow.stop(goal, statement.start)
        unused = [token for token in statement.tokens[statement.at :] if token.kind == "name" and token.word[:1] != "$"]
        self._mention([token for token in unused if not token.word.startswith("c_")], statement.file)

    def _shifted(self, statement: TokenLine, move: str, state: FrameState) -> list[Target] | None:
        """Take a point with a shift in its own axes, ``P:{X …,Y …,Z …,A …,B …,C …}``; None where no such comes next.

        The target of its own that it becomes, none where it stays.
        """
        begin = statement.at
        variable = self.data.lookup(statement.file, statement.word()) if statement.next.kind == "name" else None
        statement.at += 1
        index = statement.index()
        braces = aggregate(statement, self.listing) if statement.take(":") else None
        T = None if braces is None else braces.frame()
        targets = [] if variable is None else [t for at, t in variable.targets.items() if index in (None, at)]
        if variable is None or not targets or variable.changes or T is None or statement.word() == ":":
            statement.at = begin
            return None
        at, text = statement.tokens[0].start, self._rest(statement, begin, statement.at)
        span = statement.tokens[begin].start, statement.tokens[statement.at - 1].end
        shifts = [Shift(t, at, move, text, np.eye(4), T, True, state.tool, state.frame) for t in targets]
        new_target = self.flow.shift(shifts, span)
        self.literals += [new_target] if new_target is not None else []
        return [new_target] if new_target is not None else []

    def _relative(self, statement: TokenLine, move: str) -> bool:
        """Take a move by a distance in numbers, along the base or the tool, from a target by its tool and base."""
        state = self._checked_fdat(self.flow.state)
        start = self.flow.standing_at(state)
        statement.at = 1
        braces = aggregate(statement, self.listing)
        values = {} if braces is None else {name: value.number for name, value in braces.values.items()}
        numbers = {name: number.value for name, number in values.items() if number is not None}
        in_tool, rest = statement.take("#tool"), statement.take("#base")
        ends = statement.next is END or statement.word().startswith("c_")
        plain = len(numbers) == len(values) > 0 and not any(numbers[name] for name in numbers.keys() - {"x", "y", "z"})
        if start is None or start.kind == "joint" or start.external or not plain or not ends or (in_tool and rest):
            statement.at = 0
            return False
        T = frames.transform(None, [numbers.get(name, 0.0) * MM for name in "xyz"])
        left, right = (np.eye(4), T) if in_tool else (T, np.eye(4))
        text = self._rest(statement, 1)
        self.flow.shifts.append(Shift(start, statement.start, move, text, left, right, True, state.tool, state.frame))
        self.flow.stop_beside(statement.start)
        return True

    def _point(self, statement: TokenLine, move: str) -> PointedTargets:
        """What the argument that comes next stands for."""
        begin = statement.at
        braces = aggregate(statement, self.listing)
        if braces is not None and statement.word() != ":":
            name = f"{move} in line {self.listing.line(braces.start)}"
            parsed, reason = target(name, "", braces, self.listing)
            text = self.listing.quote(braces.start, braces.end)
            if parsed is None:
                return [], text, reason
            self.literals.append(parsed)
            return [parsed], text, ""
        statement.at = begin
        token = statement.next
        if token.kind != "name":
            return [], self._rest(statement, begin), "its target is computed"
        statement.at += 1
        index = statement.index()
        text = self._rest(statement, begin, statement.at)
        if statement.word() in (":", ".", "(", "+", "-"):
            self._mention(statement.tokens[begin:], statement.file)
            statement.at = len(statement.tokens)
            return [], self._rest(statement, begin), "its target is computed"
        variable = self.data.lookup(statement.file, token.word)
        if _HOME.fullmatch(token.word) and (variable is None or self.data.system(variable.file)):
            self.notes.append((token.start, f"{text} is a joint target of the controller's own: it is left as it was"))
            return [], "", ""
        if variable is None:
            return [], text, f"{text} is not declared in these files"
        if self.data.system(variable.file):
            self.notes.append((token.start, f"{text} stands in a file that other programs share: it is left as it was"))
            return [], "", ""
        return self._of_variable(variable, index, text)

    def _of_variable(self, variable: Variable, index: tuple[int, ...] | None, text: str) -> PointedTargets:
        targets = [target_at for at, target_at in variable.targets.items() if index is None or at == index]
        if variable.changes:
            statement = self.listing.line(variable.changes[0])
            return targets, text, f"{text} is computed, changed or not whole in line {statement}"
        if not targets:
            return [], text, f"{text} has no value in these files"
        return targets, text, ""

    def _mention(self, tokens: list[Token], file: int) -> None:
        """Note names that are used in another way than as the target of a move."""
        self._mentioned += [(token, file) for token in names_in(tokens)]

    def conclude(self) -> None:
        """Tell targets where they are used in another way than in a move, and where their tools and bases change."""
        for token, file in self._mentioned:
            variable = self.data.lookup(file, token.word)
            if variable is not None and not self.data.system(variable.file):  # those of the system stay in any case
                for mentioned in variable.targets.values():
                    self.flow.mention(mentioned, token.start)
        for used in [*self.literals, *(each for v in self.data.variables.values() for each in v.targets.values())]:
            for word in NUMBERED if self._changed else ():
                for number in {(use.tool if word == "tool_data" else use.work_object) or ANY for use in used.uses}:
                    at = self._changed.get((word, number), self._changed.get((word, ANY)))
                    if at is not None:
                        used.conflicts.append(f"line {self.listing.line(at)} changes {word.upper()}[{number}]")

    def _rest(self, statement: TokenLine, begin: int, end: int | None = None) -> str:
        tokens = statement.tokens[begin:end]
        return self.listing.quote(tokens[0].start, tokens[-1].end) if tokens else ""


_BEGIN = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(DEF|DEFFCT|DEFDAT)\b", re.IGNORECASE | re.MULTILINE)


def looks_like(data: bytes) -> bool:
    """Whether a file looks like KRL."""
    return data.lstrip(b"\xef\xbb\xbf \r\n\t").upper().startswith(b"&ACCESS") or _BEGIN.search(data) is not None


_SYSTEM = frozenset(["mada", "steu", "system", "tp"])
"""Folders of a backup (``KRC``) that hold the controller's own files; of those ``$config.dat`` says tools and bases."""


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read KRL for an arm: all files are one program; see `irbcal.correction.languages.Language`."""
    files = [path for path in files if not _of_the_system(path) or path.name.lower() == "$config.dat"] or list(files)
    for file in [file for file in files if file.suffix.lower() in (".src", ".sub")]:
        files += [path for path in files_named(file.parent, file.stem.lower() + ".dat") if path not in files]
    if all(file.suffix.lower() == ".dat" for file in files):
        program = files[0].with_suffix(".src").name
        raise ProgramError(f"a data list has targets, but no moves: give its program, too ({program})", file=files[0])
    contents, unread = each_read(files, _checked)
    return [parse(arm, contents, setup), *unread]


def _of_the_system(path: Path) -> bool:
    folders = [word.lower() for word in path.parts]
    return "krc" in folders and bool(_SYSTEM & {*folders[folders.index("krc") :]})


def _checked(file: Path) -> tuple[str, bytes]:
    """Name and content of a file of KRL."""
    data = read_bytes(file)
    if not looks_like(data):
        raise ProgramError("expected a KRL program with DEF or DEFDAT", file=file)
    lines_of(Listing([(str(file), data)], "KUKA KRL"))
    return str(file), data


def parse(arm: Arm, files: Sequence[tuple[str, bytes]], setup: ControllerSetup, maker: Maker = KUKA) -> KrlProgram:
    """Read KRL from the names and contents of files.

    Raises
    ------
    ProgramError
        If this is no KRL, or a tool or base that is needed is not known.
    """
    # declarations before routines, so that moves find their targets
    ordered = sorted(files, key=lambda file: (Path(file[0]).suffix.lower() != ".dat", files.index(file)))
    listing = Listing(ordered, "KUKA KRL")
    lines, comments = lines_of(listing)
    data = KrlData(listing, [str(Path(file.name).with_suffix("")).lower() for file in listing.files])
    statements_left = [
        statement for statement in lines if statement.tokens[0].word != "&" and not data.declaration(statement)
    ]
    taught = setup.instructions.get("krl", {})
    statements = Statements(listing, data, setup.ignored_calls, setup.split_points, taught)
    statements_left = _values_first(statements, data, statements_left)
    data.collect()
    statements.follow(statements_left)
    for statement in statements_left:
        statement.at = 0
        statements.statement(statement)
    statements.conclude()
    targets = [literal for variable in data.variables.values() for literal in variable.targets.values()]
    return _program(arm, maker, listing, setup, statements, [*targets, *statements.literals], comments)


def _values_first(statements: Statements, data: KrlData, lines: list[TokenLine]) -> list[TokenLine]:
    """Take values of data files and assignments in numbers; returns the other lines."""
    statements_left = []
    for statement in lines:
        statement.at = 0
        if _is_value(statement, data):
            statements.statement(statement)
        else:
            statements_left.append(statement)
    return statements_left


def _is_value(statement: TokenLine, data: KrlData) -> bool:
    """Whether a line gives a value to a variable that is declared, to one of its components, or to a numbered frame."""
    if statement.next.kind != "name" or statement.word() in ("$tool", "$base", "fdat_act"):
        return False
    name = statement.word()
    statement.at = 1
    index = statement.index()
    member = statement.word() == "." and statement.word(2) == "="
    setup = statement.take("=") and statement.word() != ""
    statement.at = 0
    if name in NUMBERED:
        return setup and bool(index)
    variable = data.lookup(statement.file, name)
    return (setup or member) and variable is not None and variable.type in TYPES


def _program(
    arm: Arm,
    maker: Maker,
    listing: Listing,
    setup: ControllerSetup,
    statements: Statements,
    targets: list[Target],
    comments: list[str],
) -> KrlProgram:
    targets.sort(key=lambda target: target.start)
    if len(listing.files) > 1:
        for target in targets:
            target.name += f" of {Path(listing.files[listing.file_at(target.start)].name).name}"
    eye = {NULLFRAME: frames.transform()}
    main = next((p for p in listing.files if Path(p.name).suffix.lower() != ".dat"), listing.files[0])
    notes = [Note(listing.line(at), text) for at, text in statements.notes]
    status = [
        integer(listing.text[slice(*target.configuration_spans[0])]) for target in targets if target.configuration_spans
    ]
    if any((value or 0) & 16 for value in status) and setup.controller_arm is None:
        text = (
            "points say (S, bit 4) that the robot was absolutely accurate: it must not be corrected twice; what such a "
            "controller computes with is given with --controller-model"
        )
        notes.append(Note(1, text))
    return KrlProgram.assembled(
        maker,
        arm,
        statements.flow,
        targets,
        setup,
        {**statements.tools, **eye},
        {**statements.frames, **eye},
        source=main.name,
        notes=dict.fromkeys(notes),
        comments=comments,
        mark_at=_behind_head(listing, main.start, main.end),
        marks_beside=tuple(_behind_head(listing, p.start, p.end) for p in listing.files if p is not main),
    )


def _behind_head(listing: Listing, start: int, end: int) -> int:
    """Behind the first line with ``DEF``; before everything where there is none."""
    match = _BEGIN.search(listing.text[start:end].encode("latin-1"))
    if match is None:
        return start
    at = listing.after_line(start + match.start())
    return at if at < end or listing.text[at - 1 : at] in "\r\n" else start


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.src``: PTP moves to axes with exact stops; external axes stay where they are."""
    lines = ["&ACCESS RVP", "DEF plan( )", *(f"; {note(text)}" for text in moves.head)]
    lines += ["BAS (#INITMOV,0)", "BAS (#ACC_PTP,50)"]
    percent = 0
    for move, joints in zip(moves.moves, moves.texts(KUKA), strict=True):
        lines += [f"; {note(move.comment)}"] if move.comment else []
        if move.percent != percent:
            percent = move.percent
            lines.append(f"BAS (#VEL_PTP,{percent})")
        lines.append(f"PTP {{{', '.join(f'A{k} {text}' for k, text in enumerate(joints, start=1))}}}")
        lines += [f"WAIT SEC {move.wait_s:.1f}"] if move.wait_s else []
    return {"plan.src": "\r\n".join([*lines, "END", ""])}


_ROBROOT = re.compile(r"^[ \t]*(?:DECL[ \t]+)?(?:FRAME[ \t]+)?\$ROBROOT[ \t]*=[ \t]*\{([^{}\r\n]*)\}", re.I | re.M)
_ABS_ACCUR = re.compile(r"^[^;\r\n]*\$ABS_ACCUR[ \t]*=[ \t]*(?:TRUE|#ACTIVATED)\b", re.I | re.M)
_DEACTIVATED = re.compile(
    r"^[^;\r\n]*\$(?:DEACTIVATE_ABS_ACCUR[ \t]*=[ \t]*TRUE|ABS_ACCUR[ \t]*=[ \t]*FALSE)\b", re.I | re.M
)
_OF_ROBOT = ("roboter", "ir_spec", "rdc")
"""Folders beside ``KRC`` in archives that hold the files of one robot."""
_COMPONENT = re.compile(r"\b([XYZABC])[ \t]+([-+]?(?:\d+\.?\d*|\.\d+)(?:E[-+]?\d+)?)", re.I)


def backup(files: Sequence[Path]) -> Backup:
    """Where the robot stands (``$ROBROOT``), and whether the controller corrects it itself.

    It does by ``$ABS_ACCUR``, and with the ``.pid`` file of an absolutely accurate robot, which newer controllers use
    unless ``$DEACTIVATE_ABS_ACCUR``.
    """
    out = Backup()
    for root in folders_named(files, "krc"):
        folders = [root, *(path for path in root.parent.glob("*") if path.name.lower() in _OF_ROBOT and path.is_dir())]
        of_robot = sorted(path for folder in folders for path in folder.rglob("*") if path.suffix.lower() == ".pid")
        deactivated = False
        for path in sorted(path for path in root.rglob("$*") if path.suffix.lower() == ".dat" and path.is_file()):
            text = text_of(path)
            deactivated |= _DEACTIVATED.search(text) is not None
            if _ABS_ACCUR.search(text):
                out = out._replace(accuracy=f"the robot is absolutely accurate ($ABS_ACCUR in {path.name})")
            for match in _ROBROOT.finditer(text):
                values = {name.upper(): float(value) for name, value in _COMPONENT.findall(match[1])}
                if len(values) == len(POSE):
                    out = placed(out, KUKA.frame([values[name.upper()] for name in POSE]), path)
        if of_robot and not deactivated and not out.accuracy:
            out = out._replace(accuracy=f"the robot is absolutely accurate ({of_robot[0].name} is in the backup)")
    for path in files:
        if path.suffix.lower() in (".src", ".sub") and _ABS_ACCUR.search(text_of(path)):
            out = out._replace(accuracy=f"{path.name} switches on that the robot is absolutely accurate ($ABS_ACCUR)")
    return out


LANGUAGE = Language(
    name="KUKA KRL",
    endings=(".src", ".dat", ".sub"),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(lambda listing: lines_of(listing)[1], "KUKA KRL"),
    maker=KUKA,
    robots=r"kuka|(^|_)k[ru]\d",
    write_moves=write_moves,
    motions=MOTIONS,
    backup=backup,
    declaration=FrameDeclaration(
        *TO_99,
        head="DEFDAT $CONFIG",
        tool="TOOL_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        work_object="BASE_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        foot="ENDDAT",
        held_part="TOOL_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
        fixed_tool="BASE_DATA[{name}]={{X {0},Y {1},Z {2},A {3},B {4},C {5}}}",
    ),
    sample=SampleArm(
        folder="kuka",
        joints=(
            ((0, 0, 0.4), "0 0 -1"),
            ((0.025, 0, 0), "0 1 0"),
            ((0.45, 0, 0), "0 1 0"),
            ((0.42, 0, 0.035), "-1 0 0"),
            ((0, 0, 0), "0 1 0"),
            ((0, 0, 0), "-1 0 0"),
        ),
        flange=(0.08, 0, 0, 0, np.pi / 2, 0),
        stops=((10, -80, 100, 20, 40, 30), (-25, -95, 110, -15, 50, -40), (30, -70, 80, 10, -35, 60)),
        frame=(400, 0, 200, 0, 0, 0),
        tried={"job.src": "--out kuka-job --tool 3=0,0,150,0,0,0 --frame 1=400,0,200,0,0,0"},
    ),
)
