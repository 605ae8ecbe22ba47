r"""ABB RAPID modules: which targets stand in them as numbers, and which moves use them.

`irbcal.correction.languages.rapid_reader` reads the text, `irbcal.correction.languages.rapid_paths` cuts paths.

Literals of ``robtarget`` and ``jointtarget`` in declarations, in assignments and inside moves are read; a move whose
target the program computes (arithmetic, a function) is reported and left. A target that is also shifted by ``Offs`` or
``RelTool`` is corrected for its direct moves, and what becomes of the shifted one is told. A target is not
corrected where its literal does more than the direct moves that use it: where it is also an argument of something
else, where its variable is also computed, where moves use it with different tools or work objects. Uses in
other modules of the same call count, see `Task`; what is not in the call is not seen.
"""

from __future__ import annotations

import bisect
import functools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.correction import notation
from irbcal.correction.backup import Backup, files_named, folders_named, placed, text_of
from irbcal.correction.calls import Calls, may_set_load
from irbcal.correction.control_flow import ControlFlow
from irbcal.correction.instructions import TO, TOOL, VIA, WRITES, MotionInstruction, built_in, teaching
from irbcal.correction.language import ANY_WORD, FrameDeclaration, Language, SampleArm, mark_among
from irbcal.correction.languages.rapid_paths import InOrder, PathText, insertions, paths, robtarget
from irbcal.correction.languages.rapid_reader import (
    ABSENT,
    BLOCK_ENDS,
    BUILT_IN,
    JUMPS,
    OPENING,
    ROUTINES,
    Arg,
    Literal,
    Mention,
    MoveInstruction,
    Node,
    RapidData,
    Reader,
    Scope,
    Subscripts,
    may_be,
    steps,
)
from irbcal.correction.listing import Edit, Listing, Number, mark_in, up_to_next
from irbcal.correction.loads import Carrying, Load, LoadFlow, load_of, unknown_load
from irbcal.correction.maker import (
    NO_CONFDATA,
    NO_POSTURE,
    NO_REACH,
    ConfData,
    Maker,
    Posture,
    Solutions,
    configuration_of,
    seeds_of,
)
from irbcal.correction.moves import Moves, note
from irbcal.correction.notation import DECIMALS, QUATERNION_DECIMALS, number_text
from irbcal.correction.paths import CutPath, PathMove
from irbcal.correction.program import ControllerSetup, Note, Program, TargetKind, each_read, read_bytes
from irbcal.correction.targets import START, Configuration, Shift, Target, Use, complete
from irbcal.correction.text_program import TextProgram, needed_frames
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import nearly_closed_form
from irbcal.units import DEG, MM

ABB = Maker(
    name="RAPID",
    orientation=notation.Quaternion(),
    length=MM,
    angle=1.0,
    joint=DEG,
    decimals=(DECIMALS, QUATERNION_DECIMALS, DECIMALS),
    axes=(),
    matrix=np.eye(6),
    largest=ABSENT,
)

MOTIONS = built_in(
    """
    # joint and straight moves, circles
    MoveJ MoveL MoveAbsJ: to speed zone tool
    MoveC: via to speed zone tool
    # with an output, with a routine
    MoveJDO MoveJAO: to speed zone tool signal value
    MoveJGO: to speed zone tool signal *
    MoveLDO MoveLAO: to speed zone tool signal value
    MoveLGO: to speed zone tool signal *
    MoveCDO MoveCAO: via to speed zone tool signal value
    MoveCGO: via to speed zone tool signal *
    MoveJSync MoveLSync: to speed zone tool routine
    MoveCSync: via to speed zone tool routine
    # with events on the path
    TriggJ TriggL TriggAbsJ: to speed trigger zone tool
    TriggC: via to speed trigger zone tool
    TriggJIOs TriggLIOs: to speed zone tool
    # searches end where something is found
    SearchL: signal writes to speed tool
    SearchC: signal writes via to speed tool
    # arc welding; weave data stand among the others in older versions
    ArcL ArcL1 ArcL2 ArcLStart ArcLEnd: to speed seam weld * tool
    ArcC ArcC1 ArcC2 ArcCStart ArcCEnd: via to speed seam weld * tool
    # spot welding, nuts
    SpotL SpotJ SpotML SpotMJ NutL NutJ: to speed * tool
    # dispensing, painting, the continuous application platform
    DispL: to speed bead zone tool
    DispC: via to speed bead zone tool
    PaintL: to speed * zone tool
    PaintC: via to speed * zone tool
    CapL: to speed cap * zone tool
    CapC: via to speed cap * zone tool
    """
)
"""With ABB's options, as their manuals list the arguments."""

KIND_OF: dict[str, TargetKind] = {"robtarget": "pose", "jointtarget": "joint"}
_PARTS: dict[TargetKind, tuple[tuple[int, str], ...]] = {
    "pose": ((3, "[x, y, z]"), (4, "[q1, q2, q3, q4]"), (4, "[cf1, cf4, cf6, cfx]"), (6, "[six external axes]")),
    "joint": ((6, "[six joints]"), (6, "[six external axes]")),
}


class Literals:
    """All targets in numbers of a module, and everything that gives a target another value."""

    def __init__(self, listing: Listing, instructions: Mapping[str, MotionInstruction]) -> None:
        self.flow, self.reader = ControlFlow(listing), Reader(listing, instructions)
        """``reader``: the module as read. ``flow``: what looks like a target where none can be corrected, and moves to
        targets that cannot, are noted there.
        """
        self.source = listing.files[0].name
        self.targets: list[Literal] = []
        """In the order in which they are come upon."""
        self.reader.read()
        self._collect()

    def _collect(self) -> None:
        """Find all literals and everything that gives a target another value."""
        reader = self.reader
        for scope in [reader.data, *reader.scopes]:
            for data in scope.values():
                if data.type in KIND_OF:
                    if data.node is not None:
                        self._fill(data, (), data.node)
                    elif data.computed is not None:
                        data.changes.append(((), data.computed))
        for assigned in reader.assignments:
            self._assignment(*assigned)
        for move in reader.moves:
            for role, arg in move.points:
                goal = reader.lookup(move.scope, arg.name) if role == WRITES and arg.name else None
                if goal is not None:
                    goal.changes.append((arg.indices, move.start))
        for start, reason in reader.wrong:
            self.flow.leave(start, "other", reader.listing.quote_line(start), reason)
        self.lessons = self._lessons()
        for node in reader.loose:
            if _looks_like_target(node):
                text = reader.quote(node.start, node.end)
                reason = "this is no move that is known" + self.lessons.get(reader.line(node.start), "")
                self.flow.leave(node.start, "other", text, reason)

    def _lessons(self) -> dict[int, str]:
        """Of each line with a statement that may be a move, the line of a table that would teach it."""
        reader = self.reader
        out: dict[int, str] = {}
        for i in reader.calls:
            reasons: list[str] = []
            unknown: list[int] = []  # arguments that may be a tool of another module
            for k, tokens in enumerate(reader.arguments(i)):
                first = tokens[0]
                data = reader.lookup(self._scope_at(first.start), first.word) if first.kind == "name" else None
                if first.kind == "name" and data is None and not _PREDEFINED.fullmatch(first.word) and len(tokens) == 1:
                    unknown.append(k)
                if first.word == "[" or (data is not None and data.type in KIND_OF):
                    reasons.append(TO)
                else:
                    is_tool = first.word == "tool0" or (data is not None and data.type == "tooldata")
                    reasons.append(TOOL if is_tool else f"argument{k + 1}")
            count = reasons.count(TO)
            if not 0 < count <= 2:
                continue
            if count == 2:
                reasons[reasons.index(TO)] = VIA
            if TOOL not in reasons and unknown:
                reasons[unknown[-1]] = TOOL
            if reasons.count(TOOL) == 1:
                name = reader.text[reader.tokens[i].start : reader.tokens[i].end]
                out[reader.line(reader.tokens[i].start)] = teaching("rapid", name, reasons)
        return out

    def _scope_at(self, at: int) -> Scope | None:
        """Data of the routine at a place in the text."""
        before = [scope for _, scope, start in self.reader.routines if start <= at]
        return before[-1] if before else None

    def _assignment(self, scope: Scope | None, name: str, index: Subscripts, node: Node | None, start: int) -> None:
        data = self.reader.lookup(scope, name)
        if data is not None and data.type in KIND_OF and node is not None:
            self._fill(data, index, node)
        elif data is not None:
            data.changes.append((index, start))
        if (data is None or data.type == "parameter") and node is not None and _looks_like_target(node):
            where = "is not declared in this module" if data is None else "is a parameter of the routine"
            self.flow.leave(start, "assignment", name, where)

    def _fill(self, data: RapidData, index: Subscripts, node: Node) -> None:
        """Take the literals of a declaration or an assignment, element by element."""
        sizes = data.sizes[len(index) :] if not index or len(index) == len(data.sizes) else ()
        kind = KIND_OF[data.type]
        pending = [(index, node, sizes)]
        while pending:
            index, node, sizes = pending.pop()
            if sizes:
                if node.elements is None:
                    data.changes.append((index, node.start))
                    continue
                if sizes[0] is not None and len(node.elements) != sizes[0]:
                    reason = f"expected {sizes[0]} elements, found {len(node.elements)}"
                    self.flow.leave(node.start, data.type, data.spelling, reason)
                    data.changes.append((index, node.start))
                    continue
                new = [((*index, k + 1), node_of_element, sizes[1:]) for k, node_of_element in enumerate(node.elements)]
                pending.extend(reversed(new))
                continue
            inside = ",".join("?" if k is None else str(k) for k in index)
            name = data.spelling + (f"{{{inside}}}" if index else "")
            literal, reason = self.literal(node, kind, name)
            if reason:
                self.flow.leave(node.start, data.type, name, reason)
            if literal is None:
                data.changes.append((index, node.start))
            else:
                data.entries.append((index, literal))

    def literal(self, node: Node, kind: TargetKind, name: str) -> tuple[Literal | None, str]:
        """The literal that a list of values is, or None; and what is wrong where it is no target at all."""
        if node.elements is None:
            return None, ""
        if wrong := self._wrong_part(node.elements, kind):
            return None, wrong
        values = [component.elements for component in (node.elements[:2] if kind == "pose" else node.elements[:1])]
        numbers = [leaf for leaves in values for leaf in leaves or ()]
        if any(leaves is None for leaves in values):
            return None, ""
        for leaf in numbers:
            if leaf.elements is not None:
                return None, f"expected a number, found {self.reader.quote(leaf.start, leaf.end)}"
        if any(leaf.number is None for leaf in numbers):
            return None, ""
        leaves = self._configuration(node.elements[2]) if kind == "pose" else []
        axes = node.elements[-1]
        literal = Literal(
            name,
            kind,
            node.start,
            [Number(leaf.number, leaf.start, leaf.end) for leaf in numbers if leaf.number is not None],
            ConfData(*(int(leaf.number or 0) for leaf in leaves)) if leaves else None,
            tuple((leaf.start, leaf.end) for leaf in leaves),
            self.reader.text[axes.start : axes.end],
            {
                f"e{k}": leaf.number
                for k, leaf in enumerate(axes.elements or (), 1)
                if leaf.number is not None and abs(leaf.number) < ABSENT
            },
        )
        absent = [k for k, value in enumerate(literal.written, start=1) if abs(value) >= ABSENT]
        if kind == "joint" and absent:
            literal.conflicts.append(f"joint {absent[0]} has no value (9E9)")
        self.targets.append(literal)
        return literal, ""

    def _wrong_part(self, components: list[Node], kind: TargetKind) -> str:
        """Which part of a list is none of a target; empty where all are."""
        if len(components) != len(_PARTS[kind]):
            expected = "[" + ", ".join(text for _, text in _PARTS[kind]) + "]"
            return f"expected {expected}, found {len(components)} parts"
        for component, (size, text) in zip(components, _PARTS[kind], strict=True):
            if component.number is not None or (component.elements is not None and len(component.elements) != size):
                return f"expected {text}, found {self.reader.quote(component.start, component.end)}"
        return ""

    def _configuration(self, component: Node) -> list[Node]:
        """The four numbers of configuration data; empty if they are computed, or not whole."""
        numbers = [leaf.number for leaf in component.elements or () if leaf.number is not None]
        if component.elements is None or len(numbers) < len(component.elements):
            return []
        return [] if any(abs(number) > ABSENT * 100 or number % 1 for number in numbers) else component.elements


def _looks_like_target(node: Node) -> bool:
    sizes = [len(component.elements) if component.elements is not None else None for component in node.elements or []]
    return sizes in ([3, 4, 4, 6], [6, 6])


_PREDEFINED = re.compile(r"v\d+|vmax|z\d+|fine|wobj0|load0|true|false")
_JOINT_MOVE = re.compile(r"J(DO|AO|GO|Sync|IOs|Start|End|\d)*$")


class Task:
    """The modules of a task, and what they see of one another.

    Data that a module declares outside its routines, without ``LOCAL``, are seen by all modules of the task that do not
    declare the name themselves. A target is followed there where one file alone declares it; uses, mentions and new
    values in other files then count as those of its own module do; tools and work objects must mean the same frame in
    all files.
    """

    def __init__(self, modules: Sequence[Literals], setup: ControllerSetup) -> None:
        self.modules, self.setup, self.readers = modules, setup, [module.reader for module in modules]
        tools, work_objects = {"tool0": np.eye(4), **setup.tools}, {"wobj0": np.eye(4), **setup.work_objects}
        self.user_frames = {"tooldata": tools, "wobjdata": work_objects}
        """Frames from the caller, which go before, and those that are always there, by type and by name."""
        self.frames = {module.source: frames_in_numbers(module.reader) for module in modules}
        """Tools and work objects that each file defines in numbers, by file, by type and by name."""
        self.calls, self.loads = Calls(setup.ignored_calls, BUILT_IN), LoadFlow()
        self.public: dict[str, list[tuple[RapidData, Literals]]] = {}
        """Data that other modules see, by their names, with the modules that declare them."""
        for module in modules:
            learn(module.reader, self.calls)
            for name, data in module.reader.data.items():
                if not data.local:
                    self.public.setdefault(name, []).append((data, module))
        self.grips = any(token.word == "gripload" for reader in self.readers for token in reader.tokens)
        """Whether a module says what the robot carries."""
        totals = (_total_load(move) for reader in self.readers for move in reader.moves)
        self.loads.names_any = self.grips or any(total is not None for total in totals)

    @functools.cached_property
    def first(self) -> list[Scope | None]:
        """Data of the routine with which the program begins, ``main`` or the only one that moves; of several: all."""
        mains = [scope for reader in self.readers for name, scope, _ in reader.routines if name == "main"]
        return [*mains] or [*{id(move.scope): move.scope for reader in self.readers for move in reader.moves}.values()]

    def assigns(self, name: str) -> bool:
        """Whether a module assigns a value to a name."""
        return any(change.name == name for reader in self.readers for change in reader.assignments)

    def frame_problem(self, type_name: str, name: str) -> str:
        """What speaks against a tool or work object of a move here to a target there; empty where nothing does."""
        if name in self.user_frames[type_name]:
            return ""
        declared = [reader for reader in self.readers if name in reader.data]
        definitions = [types[type_name][name] for types in self.frames.values() if name in types[type_name]]
        title = "tool" if type_name == "tooldata" else "work object"
        if not definitions or len(definitions) < len(declared):
            return f"the {title} {name} is not defined in numbers in these modules"
        if any(not np.array_equal(T, definitions[0]) for T in definitions):
            return f"the {title} {name} is another one in another module"
        return f"the {title} {name} is changed" if self.assigns(name) else ""


_QUOTED = 3  # mentions of a target that are quoted before the rest is counted


class Uses:
    """The uses of the targets of a module of a task."""

    def __init__(self, literals: Literals, task: Task) -> None:
        self.task, self.literals, self.reader, self.flow = task, literals, literals.reader, literals.flow
        own_frames, every = task.frames[literals.source], task.frames.values()
        self.user_frames = {
            kind: {name: T for types in every for name, T in types[kind].items() if name not in own_frames[kind]} | user
            for kind, user in task.user_frames.items()
        }
        """Frames that the module does not define itself, by type and by name."""
        self.flow.split_points, self.flow.first_begins = task.setup.split_points, True
        self.flow.calls, self.flow.loads = task.calls, task.loads
        self.in_order: list[InOrder] = []
        """The moves as they stand in the text."""
        self._shifted: dict[tuple[int, str], Literal | None] = {}

    def _elsewhere(self, name: str) -> list[tuple[RapidData, str]]:
        """What other modules declare by a name that this one does not, with their files."""
        declarations = self.task.public.get(name, ()) if name not in self.reader.data else ()
        return [(data, Path(module.source).name) for data, module in declarations if module is not self.literals]

    def _of_others(self, name: str) -> RapidData | None:
        """The targets that a name stands for in the one other module that declares it."""
        elsewhere = self._elsewhere(name)
        return elsewhere[0][0] if len(elsewhere) == 1 and elsewhere[0][0].type in KIND_OF else None

    def _against(self, name: str, index: Subscripts, reason: str) -> None:
        """Note what this module does to targets of others but to move to them."""
        data = self._of_others(name)
        for literal in [] if data is None else data.literals(index):
            literal.conflicts.append(reason)

    def gather(self) -> None:
        """Give every literal its uses, those of other modules, too.

        A move that uses what cannot be its target, its tool or its work object is left.
        """
        self._shifts()
        self._mentions()
        self._follow()

    def _follow(self) -> None:
        """Take the moves in the order of the text, with the branches, calls and loads between them."""
        reader, flow = self.reader, self.flow
        flow.previous = None
        routines = {start: (name, scope) for name, scope, start in reader.routines}
        waiting = list(reversed(reader.moves))
        scope: Scope | None = None
        for i, step in steps(reader):
            _, word, start, _ = reader.tokens[i]
            while waiting and waiting[-1].start <= start:
                self._move(waiting.pop())
            if step == "name in a text":
                flow.forget()
                flow.loads.call("%", True, may_set_load("a routine by its name in a text", reader.line(start)))
            elif step == "end of IF":  # the move behind it may not have been made
                flow.close(start)
                flow.forget()
            elif step == "label" or word in JUMPS:
                flow.label(start)
            elif word == "gripload":
                flow.carry(self._load_named(scope, i + 1), start)
            elif step == "call":
                flow.call(word, reader.text[start : start + len(word)], start)
            elif word in OPENING:
                flow.open(word in ("for", "while"))
            elif word in BLOCK_ENDS:
                flow.close(start)
            elif word in ("elseif", "else", "case", "default"):
                flow.alternative()
            elif start in routines:
                name, scope = routines[start]
                flow.restart(name, Load(0.0) if name == "main" else None)  # a start from main sets load0
                flow.previous = START if len(self.task.first) == 1 and self.task.first[0] is scope else None
            elif step == "branch":
                flow.previous = None
                if word == "return":
                    flow.loads.returns()
                elif word in ("endproc", "endfunc", "endtrap"):
                    flow.loads.end()
                    scope = None
            elif not self.in_order or self.in_order[-1].move.start != start:  # a move with other arguments than known
                flow.forget()
        for move in reversed(waiting):
            self._move(move)

    def _shifts(self) -> None:
        """Note moves that shift a target of this module; other shifts are uses in another way."""
        reader = self.reader
        for shift in reader.shifted:
            move = reader.moves[shift.move]
            data = reader.lookup(move.scope, shift.name)
            literals = data.literals(shift.indices) if data is not None and data.type == "robtarget" else []
            if not literals or data is None or data.changes or len(shift.indices) != len(data.sizes):
                index = () if None in shift.indices else shift.indices
                reader.mentions.append(Mention(move.scope, shift.name, index, shift.start))
                continue
            tool, wobj, _, _ = self._frames(move)
            T = frames.transform(None, np.array(shift.numbers or (0.0, 0.0, 0.0)) * MM)
            left, right = (np.eye(4), T) if shift.in_tool else (T, np.eye(4))
            known = shift.numbers is not None
            arg = next(arg for _, arg in move.points if arg.start <= shift.start < arg.end)
            new_target = self.flow.shift(
                [Shift(each, move.start, move.name, arg.text, left, right, known, tool, wobj) for each in literals],
                (arg.start, arg.end),
            )
            if isinstance(new_target, Literal):
                new_target.mentioned, new_target.monitored = [], set()
                self.literals.targets.append(new_target)
            self._shifted[move.start, arg.text] = new_target if isinstance(new_target, Literal) else None

    def _move(self, move: MoveInstruction) -> None:
        """Give the literals that a move goes to this use, or report what is in the way."""
        reader = self.reader
        kind: TargetKind = "joint" if move.name.endswith("AbsJ") else "pose"
        line = reader.line(move.start)
        tool, wobj, part_on_robot, unclear = self._frames(move)
        use = Use(line, reader.listing.column(move.start), move.name, "to", tool, wobj, part_on_robot=part_on_robot)
        unknown = unclear if kind == "pose" else ""
        carried = self._carrying(move, tool, part_on_robot)
        points: list[tuple[list[Literal], bool]] = []
        """For each point the literals that it may stand for, and whether it may be another place."""
        monitored, file = self._monitored(move) if kind == "pose" else True, Path(self.literals.source).name
        for role, arg in move.points:
            if role == WRITES:
                continue
            data = self._of_other_module(move, arg, kind)
            if data is not None:
                literals, against = data.literals(arg.indices), self._against_other(data, arg, use, unknown)
                reason = "; ".join(against) or ("" if literals else "it has no value in numbers")
                points.append(([], True))
            else:
                literals, reason = self._goals(move, arg, kind, line)
                new_target = self._shifted.get((move.start, arg.text))
                if new_target is not None and not unknown:
                    literals, reason = [new_target], ""
                points.append((literals, bool(reason)))
                if new_target is None and (move.start, arg.text) in self._shifted and not unknown:
                    continue
                against = [text for text in (reason, unknown) if text]
                reason = reason or unknown
            if reason:
                self.flow.leave(move.start, move.name, arg.text, reason)
            for literal in literals:
                literal.monitored.add(monitored)
                literal.inverted |= part_on_robot and kind == "pose"
                literal.uses.append(
                    replace(use, role="via" if role == VIA else "to", file="" if data is None else file)
                )
                literal.carried.append(carried)
                literal.previous += [] if data is None else [None]
                literal.conflicts.extend(against)
        self._stops(move, points)

    def _stops(self, move: MoveInstruction, points: Sequence[tuple[list[Literal], bool]]) -> None:
        """Note the stops of a move at its points, and the move before where the arm comes from there."""
        flow = self.flow
        ends = [literals[0] if len(literals) == 1 and not computed else None for literals, computed in points]
        previous = flow.previous if self.in_order and flow.previous is not START else None
        self.in_order.append(InOrder(move, ends, None if previous is None else (self.in_order[-1].move, previous)))
        for (literals, _), end in zip(points, ends, strict=True):
            previous = None if end is None else flow.previous
            for literal in literals or (None,):
                flow.previous = previous
                flow.stop(literal, move.start)
            flow.previous = end
        if move.name.startswith("Search"):  # it ends where something was found
            flow.forget()

    def _carrying(self, move: MoveInstruction, tool: str | None, held: bool) -> Carrying:
        """What the robot carries in a move: the part, and by itself the tool (its ``tload``)."""
        ways = self.flow.loads.now if self.task.grips else frozenset([None])
        if not self.flow.loads.names_any:
            return Carrying(ways)
        total = _total_load(move)
        if total is not None:
            self.flow.names_loads.append(move.start)
            ways = frozenset([unknown_load(f"\\TLoad:={total.text} says the load of the move alone")])
        data = next((reader.data[tool] for reader in self.task.readers if tool in reader.data), None)
        of_tool = unknown_load(f"the tool {tool} has no load in numbers in these modules")
        if tool == "tool0":
            of_tool = Load(0.0)
        elif data is not None and data.node is not None and len(data.node.elements or ()) == 3 and not data.changes:
            of_tool = _load((data.node.elements or [])[2])
        return Carrying(ways, of_tool, "" if held or tool is None else tool)

    def _load_named(self, scope: Scope | None, i: int) -> Load:
        """The load that an argument is."""
        reader = self.reader
        token = reader.tokens[i]
        if token.word == "load0":
            return Load(0.0)
        if token.word == "[":
            return _load(reader._list(i)[0])
        data = reader.lookup(scope, token.word)
        if data is None:
            candidates = [each.data[token.word] for each in self.task.readers if token.word in each.data]
            data = candidates[0] if len(candidates) == 1 else None
        changed = data is not None and (data.changes or self.task.assigns(token.word))
        if data is None or data.node is None or data.type != "loaddata" or changed:
            text = reader.text[token.start : token.end]
            return unknown_load(
                f"the load {text} of GripLoad in line {reader.line(token.start)} is not in numbers that stay"
            )
        return _load(data.node)

    def _monitored(self, move: MoveInstruction) -> bool | None:
        """Whether the configuration of a pose counts in a move; None where that depends on who calls the routine."""
        moves = "j" if _JOINT_MOVE.search(move.name) else "l"
        every = [switch for reader in self.task.readers for switch in reader.monitoring]
        switches = [switch for switch in every if switch.moves == moves]
        if all(switch.on for switch in (every if move.taught else switches)):
            return True
        if move.taught:  # which kind of move it is, is not known
            return None
        in_routine = [
            switch for switch in self.reader.monitoring if switch.moves == moves and switch.scope is move.scope
        ]
        earlier_switches = [switch for switch in in_routine if switch.start < move.start]
        if not earlier_switches:
            return None
        first, last = earlier_switches[0], earlier_switches[-1]
        branches = self.reader.branches
        straight = bisect.bisect(branches, last.start) == bisect.bisect(branches, move.start)
        from_begin = next((start for _, scope, start in self.reader.routines if scope is move.scope), 0)
        alike = bisect.bisect(branches, from_begin) == bisect.bisect(branches, first.start)
        if not straight and not (alike and all(switch.on is first.on for switch in in_routine)):
            return None
        outside = [
            switch for switch in switches if switch.scope is not move.scope
        ]  # a routine that is called, or calls
        return last.on if all(switch.on is last.on for switch in outside) else None

    def _of_other_module(self, move: MoveInstruction, arg: Arg, kind: TargetKind) -> RapidData | None:
        """What an argument names in another module; None where it is no target there."""
        if arg.name is None or self.reader.lookup(move.scope, arg.name) is not None:
            return None
        data = self._of_others(arg.name)
        return data if data is not None and KIND_OF[data.type] == kind and len(arg.indices) == len(data.sizes) else None

    def _against_other(self, data: RapidData, arg: Arg, use: Use, unknown: str) -> list[str]:
        """What speaks against a use of another module's target."""
        frames = (("tooldata", use.tool), ("wobjdata", use.work_object)) if data.type == "robtarget" else ()
        against = [f"{unknown} of {Path(self.literals.source).name}"] if unknown else []
        against += [problem for kind, name in frames if name and (problem := self.task.frame_problem(kind, name))]
        changed = any(may_be(index, arg.indices) for index, _ in data.changes)
        return [*against, *(["it is computed or changed in its own module"] if changed else [])]

    def _goals(self, move: MoveInstruction, arg: Arg, kind: TargetKind, line: int) -> tuple[list[Literal], str]:
        """Literals that an argument stands for, and why these are not all, or not to be changed."""
        reader = self.reader
        if arg.node is not None:
            literal, wrong = self.literals.literal(arg.node, kind, f"{move.name} in line {line}")
            return ([], wrong or f"its numbers are computed: {arg.text}") if literal is None else ([literal], "")
        if arg.name is None:
            if arg.text == "*":
                return [], "the position * stands in the controller only"
            return [], f"its target is computed: {arg.text}"
        data = reader.lookup(move.scope, arg.name)
        if data is None:
            return [], f"{arg.text} is not declared in this module"
        if data.type == "parameter":
            return [], f"{arg.text} is a parameter of the routine"
        if KIND_OF.get(data.type) != kind:
            return data.literals(()), f"{arg.text} is declared as {data.type}"
        if len(arg.indices) != len(data.sizes):
            message = f"{data.spelling} has {len(data.sizes)} indices, but {arg.text} has {len(arg.indices)}"
            return data.literals(()), message
        literals = data.literals(arg.indices)
        changes = sorted(position for index, position in data.changes if may_be(index, arg.indices))
        if changes:
            return literals, f"{arg.text} is computed or changed in line {reader.line(changes[0])}"
        return literals, "" if literals else f"{arg.text} has no value in this module"

    def _frames(self, move: MoveInstruction) -> tuple[str | None, str | None, bool, str]:
        """What is on the flange, what stands, whether the robot holds the part; and why they are not known."""
        tool, no_tool = self._frame_name(move, move.tool, "tooldata", "tool")
        wobj, no_wobj = self._frame_name(move, move.work_object, "wobjdata", "work object")
        if tool is None or wobj is None:
            return tool, wobj, False, no_tool or no_wobj
        on_flange = self._is_on_flange("tooldata", tool), self._is_on_flange("wobjdata", wobj)
        if on_flange == (False, True):
            return wobj, tool, True, ""
        if on_flange == (False, False):
            wrong = f"the tool {tool} is not held by the robot (robhold FALSE), and the work object {wobj} neither"
            return None, None, False, wrong
        return tool, wobj, False, f"the robot holds both {tool} and {wobj} (robhold TRUE)" if on_flange[1] else ""

    def _is_on_flange(self, type_name: str, name: str) -> bool:
        """Whether the robot holds a tool or work object."""
        other = next(key for key in self.user_frames if key != type_name)
        if name not in self.user_frames[type_name] and name in self.user_frames[other]:
            return other == "tooldata"
        data = self.reader.data.get(name)
        if name in self.user_frames[type_name] or data is None or data.type != type_name:
            return type_name == "tooldata"
        return is_on_flange(self.reader, data)

    def _frame_name(self, move: MoveInstruction, arg: Arg | None, type_name: str, title: str) -> tuple[str | None, str]:
        """Name of a tool or work object, or None and why there is no one name."""
        if arg is None:
            return "wobj0", ""
        if arg.name is None or arg.indices:
            return (
                None,
                f"the {title} of {move.name} in line {self.reader.line(move.start)} is computed: {arg.text}",
            )
        data = self.reader.lookup(move.scope, arg.name)
        if data is None or (arg.name in self.user_frames[type_name] and data.type != "parameter"):
            return arg.name, ""
        if data.type == "parameter" or self.reader.data.get(arg.name) is not data:
            kind = "a parameter of" if data.type == "parameter" else "declared in"
            return None, f"the {title} {arg.text} is {kind} the routine"
        if data.changes:
            return None, f"the {title} {arg.text} is changed in line {self.reader.line(data.changes[0][1])}"
        if data.type != type_name:
            return None, f"expected a {type_name}, but {arg.text} is declared as {data.type}"
        return arg.name, ""

    def _mentions(self) -> None:
        """Note where a target is used in another way than as that of a move, changed by another module, or not sure."""
        reader, file = self.reader, Path(self.literals.source).name
        for scope, name, index, start in reader.mentions:
            data = reader.lookup(scope, name)
            if data is None:
                self._against(name, index, f"line {reader.line(start)} of {file} uses it in another way")
            for literal in data.literals(index) if data is not None else ():
                literal.mentioned.append(start)
        changes = [(change.scope, change.name, change.indices, change.start) for change in reader.assignments]
        for move in reader.moves:
            for role, arg in move.points:
                if arg.name and reader.lookup(move.scope, arg.name) is None:
                    self._declared_twice(arg.name, f"line {reader.line(move.start)} of {file}")
                if role == WRITES and arg.name:
                    changes.append((move.scope, arg.name, arg.indices, move.start))
        for scope, name, index, start in changes:
            if reader.lookup(scope, name) is None:
                self._against(name, index, f"line {reader.line(start)} of {file} gives it another value")

    def _declared_twice(self, name: str, where: str) -> None:
        """A move names what may be a target that several modules declare."""
        elsewhere = self._elsewhere(name)
        if len(elsewhere) > 1 and any(data.type in KIND_OF for data, _ in elsewhere):
            reason = f"{where} uses this name, which {' and '.join(file for _, file in elsewhere)} declare"
            for data, _ in elsewhere:
                for _, literal in data.entries:
                    literal.conflicts.append(reason)

    def module(self, arm: Arm) -> Module:
        """The module, once the uses of all modules are gathered."""
        reader, literals, listing, setup = self.reader, self.literals.targets, self.reader.listing, self.task.setup
        maker = ABB.for_arm(arm)
        self.flow.settle()
        complete(literals, listing, maker)
        for literal in literals:
            if literal.kind == "pose" and literal.uses and not literal.configuration and literal.monitored != {False}:
                literal.conflicts.append("its configuration is computed, or not of whole numbers")
            lines = {reader.line(start): start for start in sorted(literal.mentioned)}
            quoted = list(lines.items())[:_QUOTED]
            literal.conflicts += [
                f"line {line} uses it in another way: {listing.quote_line(start)}{self.literals.lessons.get(line, '')}"
                for line, start in quoted
            ]
            if len(lines) > _QUOTED:
                literal.conflicts.append(f"so do {len(lines) - _QUOTED} more lines")
            literal.conflicts = list(dict.fromkeys(literal.conflicts))
        declared = self._declared_frames()
        given, world = (self.user_frames["tooldata"], self.user_frames["wobjdata"]), setup.T_world_base
        available = ControllerSetup(*given, unknown_frames(), T_world_base=world)
        tools, work_objects = needed_frames(literals, available, declared["tooldata"], declared["wobjdata"])
        targets = tuple(sorted(literals, key=lambda literal: literal.start))
        header = reader.tokens[reader.header() - 1].end
        reader.tokens.clear()  # nothing below asks for them, and the module keeps the reader
        return Module(
            source=self.literals.source,
            listing=listing,
            maker=maker,
            targets=targets,
            tools=tools,
            work_objects=work_objects,
            order=self.flow.order(targets),
            unchanged_moves=tuple(sorted(self.flow.unchanged_moves, key=lambda move: move.line)),
            notes=_notes(reader),
            fingerprint=mark_in(reader.marks),
            mark_at=header,
            arm=arm,
            controller_arm=setup.controller_arm,
            start=setup.start,
            assumed=setup.posture,
            shifts=tuple(self.flow.shifts),
            loads=self.flow.loads,
            names_loads=tuple(self.flow.names_loads),
            T_tip_flange=np.eye(4),
            moves=functools.cache(lambda: paths(reader, self.in_order, targets, tools)),
        )

    def _declared_frames(self) -> dict[str, dict[str, FloatArray]]:
        """Tools and work objects of this module that its targets use: of poses all, of joints those that are known."""
        out: dict[str, dict[str, FloatArray]] = {"tooldata": {}, "wobjdata": {}}
        for literal in self.literals.targets:
            for use in literal.uses if literal.correctable else ():
                for type_name, name in (("tooldata", use.tool), ("wobjdata", use.work_object)):
                    if (
                        name is None
                        or name in (*out[type_name], *self.user_frames[type_name])
                        or name not in self.reader.data
                    ):
                        continue
                    try:
                        out[type_name][name] = read_frame(self.reader, self.reader.data[name])
                    except ValueError as problem:
                        literal.conflicts += [str(problem)] if literal.kind == "pose" else []
        return out


def read_frame(reader: Reader, data: RapidData) -> FloatArray:
    """Frame of a tool on the flange or of a work object in the base.

    Parameters
    ----------
    reader : Reader
    data : RapidData
        Of the type ``tooldata`` or ``wobjdata``.

    Returns
    -------
    ndarray, shape (4, 4)
        ``T_tip_tcp``, or ``T_base_wobj`` = user frame times object frame; metres. A fixed tool is in the base, a work
        object that the robot holds in the tip link.

    Raises
    ------
    ValueError
        If it does not stand there in numbers, or is of a kind that is not supported.
    """
    tool = data.type == "tooldata"
    title = f"{'tool' if tool else 'work object'} {data.spelling} of line {reader.line(data.start)}"
    nodes = data.node.elements if data.node is not None else None
    if nodes is None or len(nodes) != (3 if tool else 5):
        option = f"--{'tool' if tool else 'wobj'} {data.spelling}=…"
        raise ValueError(f"{title} has no frame in numbers: give it with {option}")
    texts = [reader.text[node_of_item.start : node_of_item.end].lower() for node_of_item in nodes]
    if texts[0] not in ("true", "false"):
        raise ValueError(f"{title}: expected TRUE or FALSE for robhold, found {texts[0]}")
    if not tool and texts[1] != "true":
        moved = f"is moved by a mechanical unit (ufprog {texts[1].upper()})"
        raise ValueError(f"{title} {moved}: this is not supported")
    T = np.eye(4)
    for node in nodes[1:2] if tool else nodes[3:5]:
        lists = [leaf_nodes.elements or [] for leaf_nodes in node.elements or []]
        leaves = [leaf.number for leaf_nodes in lists for leaf in leaf_nodes if leaf.number is not None]
        if [len(leaf_nodes) for leaf_nodes in lists] != [3, 4] or len(leaves) < 7:
            expected = "a frame [[x, y, z], [q1, q2, q3, q4]] in numbers"
            spelling = reader.quote(node.start, node.end)
            raise ValueError(f"{title}: expected {expected}, found {spelling}")
        problem = ABB.problem("pose", leaves)
        if problem:
            raise ValueError(f"{title}: {problem}")
        T = T @ ABB.frame(leaves)
    return T


def is_on_flange(reader: Reader, data: RapidData) -> bool:
    """Whether the robot holds a tool or work object (``robhold``); as usual where that does not stand there."""
    nodes = data.node.elements if data.node is not None else None
    text = reader.text[nodes[0].start : nodes[0].end].lower() if nodes else ""
    return text == "true" if text in ("true", "false") else data.type == "tooldata"


def frames_in_numbers(reader: Reader) -> dict[str, dict[str, FloatArray]]:
    """Tools and work objects that a module defines in numbers, by name: ``tooldata`` what is on the flange."""
    out: dict[str, dict[str, FloatArray]] = {"tooldata": {}, "wobjdata": {}}
    for name, declared in reader.data.items():
        if declared.type in out:
            with suppress(ValueError):  # targets that need it are left
                mount = "tooldata" if is_on_flange(reader, declared) else "wobjdata"
                out[mount][name] = read_frame(reader, declared)
    return out


def learn(reader: Reader, calls: Calls) -> None:
    """Note which routines of a module move the robot, and what they call."""
    name = ""
    for i, step in steps(reader):
        word = reader.tokens[i].word
        if step == "branch" and word in ROUTINES:
            name = reader.tokens[i + (2 if word == "func" else 1)].word
            calls.learn(name)
        elif step == "name in a text" and name:
            calls.learn(name, moves=True, sets_loads=True)
        elif step in ("move", "call") and name:
            calls.learn(name, [word] if step == "call" else [], moves=step == "move", sets_loads=word == "gripload")


def _total_load(move: MoveInstruction) -> Arg | None:
    """What the option ``TLoad`` of a move names; ``load0`` leaves the load to the tool."""
    total = move.options.get("tload")
    return None if total is None or total.text.lower() == "load0" else total


def _load(node: Node) -> Load:
    """The load that ``loaddata`` in numbers are: mass in kg, centre of gravity in mm."""
    elements = node.elements or []
    mass = elements[0].number if elements else None
    leaves = (elements[1].elements if len(elements) > 1 else None) or []
    centre = [leaf.number * MM for leaf in leaves if leaf.number is not None]
    if mass is None or len(centre) != 3:
        return unknown_load("its load is not in numbers")
    return load_of(mass, centre)


NOT_MONITORED = (
    "its configuration does not count (ConfJ or ConfL is off), and no stop just before it is known: say where the "
    "program begins (--start), or next to which joints it is meant (--posture)"
)
MAY_BE_MONITORED = (
    "whether its configuration counts (ConfJ, ConfL) depends on who calls the routine, and the solution next to the "
    "stop before is another one"
)

_NOTES = {
    **dict.fromkeys(["pdispon", "pdispset"], "a program displacement moves targets that are corrected without it"),
    **dict.fromkeys(["getdataval", "setdataval", "setalldataval"], "data are reached by a name that is not followed"),
}


@dataclass(frozen=True, eq=False, repr=False)
class Module(TextProgram):
    """A RAPID module as read."""

    moves: Callable[[], tuple[tuple[PathMove, PathText], ...]] = tuple
    """Gives its straight and circular moves in the order of the text, and their text; gathered when asked for."""
    cuts: tuple[CutPath, ...] = ()
    """What is put into these; empty: nothing."""

    def meant_joints(self, poses: Sequence[int], T_base_tip: FloatArray) -> tuple[FloatArray, list[str]]:
        """Joints that the controller takes for poses: those of the configuration, or next to the stop before.

        Where ``ConfJ`` or ``ConfL`` is off the controller goes to the solution that is nearest. Where it is not known
        whether it is, both must be the same. Targets in the place of shifted ones are next to those that were shifted:
        a shift may lead across the edge of a quadrant.
        """
        targets = [self.targets[k] for k in poses]
        sets = [target.monitored if isinstance(target, Literal) else {True} for target in targets]
        free = np.array([monitored != {True} for monitored in sets], dtype=bool)
        split = np.array([target.split is not None for target in targets], dtype=bool) & ~free
        q, reasons = np.full((len(poses), 6), np.nan), ["no closed form is near the arm's: " + NO_POSTURE] * len(poses)
        if nearly_closed_form.nearest_form(self.arm) is not None:
            confs = [t.configuration if isinstance(t.configuration, ConfData) else None for t in targets]
            T = np.array(T_base_tip)
            T[split] = self._unshifted(np.asarray(poses)[split].tolist())
            q, told = seeds_of(self.arm, T, confs, self.controller_arm)
            reached: BoolArray = np.logical_and.reduce(np.isfinite(q), axis=1)
            reasons = ["" if r else NO_REACH if t else NO_CONFDATA for r, t in zip(reached, told, strict=True)]
        if not (free | split).any():
            return q, reasons
        configured = q.copy()
        rows = np.flatnonzero(free).tolist()
        for row in rows:
            q[row], reasons[row] = np.nan, NOT_MONITORED
        solutions = Solutions(self.maker, self.arm, T_base_tip, [Posture()] * len(poses), self.controller_arm)
        for row in np.flatnonzero(split & np.isfinite(q).all(axis=1)).tolist():
            start = q[row].copy()
            q[row : row + 1], (reasons[row],) = solutions.next_to(np.array([row]), start[None])
            reasons[row] = reasons[row] or solutions.unclear(start, q[row])
            q[row] = np.nan if reasons[row] else q[row]
        self.next_to_stops(poses, q, reasons, rows, solutions, solutions.unclear)
        for row in rows:
            agree = np.abs(q[row] - configured[row]).max() < 1e-6
            if not reasons[row] and sets[row] != {False} and not agree:
                q[row], reasons[row] = np.nan, MAY_BE_MONITORED
        return q, reasons

    def _unshifted(self, poses: Sequence[int]) -> FloatArray:
        """Tip poses (n, 4, 4) of the targets in whose place others stand, with the frames of these."""
        T_base_wobj, T_tip_tcp = self._frames_of(poses)
        values = [split.target.value for k in poses if (split := self.targets[k].split) is not None]
        return T_base_wobj @ np.array(values).reshape(-1, 4, 4) @ frames.inverse(T_tip_tcp)

    def path_moves(self) -> list[PathMove]:
        """The straight and circular moves, see `irbcal.correction.languages.rapid`."""
        return [move for move, _ in self.moves()]

    def with_cuts(self, cuts: Sequence[CutPath]) -> Module:
        """The module that writes points into its moves, one cut for each."""
        return replace(self, cuts=tuple(cuts))

    def mark(self, fingerprint: str, at: int) -> Edit:
        """A comment behind the line with ``MODULE``."""
        newline = self.listing.newline()
        line_end = re.match(r"[ \t]*(?:![^\r\n]*)?(\r\n|\n|\r)", self.text[at:])
        at, line_break = (at + line_end.end(), "") if line_end else (at, newline)
        return at, at, f"{line_break}! irbcal: fake targets, calibration {fingerprint}{newline}"

    def number_text(self, old: Number, new: float, decimals: int) -> str | None:
        """A number without needless zeros; the old text stays where it is the same within the decimals written."""
        return None if abs(new - old.value) <= 0.5 * 10.0**-decimals else number_text(new, decimals)

    def configuration_edits(self, target: Target, configuration: Configuration) -> list[Edit]:
        """New text of the quadrants that change."""
        if target.configuration is None:
            message = f"target {target.name} has no configuration in numbers to rewrite"
            raise ProgramError(message, file=self.source, line=target.line)
        assert isinstance(configuration, ConfData)
        assert isinstance(target.configuration, ConfData)
        pairs = zip(target.configuration_spans, configuration, target.configuration, strict=True)
        return [(*span, str(int(new))) for span, new, old in pairs if new != old]

    def split_edits(self, target: Target, numbers: list[float], configuration: Configuration | None) -> list[Edit]:
        """A literal in the move."""
        assert target.split is not None
        conf = configuration or target.configuration
        assert isinstance(conf, ConfData)
        return [(*target.split.span, robtarget(numbers, conf, target))]

    def edits(self, values: Mapping[int, FloatArray], configurations: Mapping[int, Configuration]) -> list[Edit]:
        """New text of numbers and configuration data, and points put into moves."""
        plain = super().edits(values, configurations)
        if not self.cuts:
            return plain
        inserted, replaced = insertions(self.text, self.moves(), self.cuts, self.targets, self.work_objects)
        return [*(edit for edit in plain if not any(a <= edit[0] < b for a, b in replaced)), *inserted]

    def new_configurations(self, targets: Sequence[Target], q: FloatArray) -> list[Configuration | None]:
        """Quadrants of the axes; ``cfx`` stays, and so does what does not count."""
        return [
            configuration_of(row, target.configuration.cfx)
            if isinstance(target.configuration, ConfData)
            and not (isinstance(target, Literal) and target.monitored == {False})
            else None
            for row, target in zip(q, targets, strict=True)
        ]


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a RAPID module."""
    return re.search(rb"^\s*(?:%%%[\s\S]{0,200}?)?MODULE\s+\w+", data, re.IGNORECASE | re.MULTILINE) is not None


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[Program]:
    """Read RAPID modules for an arm; see `irbcal.correction.languages.Language`.

    Tools and work objects that one of them defines in numbers serve all others of its task.
    """
    contents, _ = each_read(files, read_bytes)
    instructions = _instructions(contents, setup.instructions.get("rapid", {}))
    modules, unread = each_read(files, lambda path: Literals(_listing(read_bytes(path), str(path)), instructions))
    tasks: dict[str, list[Literals]] = {}
    for module in modules:
        tasks.setdefault(task_of(Path(module.source)), []).append(module)
    return [*(module for task in tasks.values() for module in _of_task(arm, task, setup)), *unread]


def _instructions(contents: Iterable[bytes], taught: Mapping[str, MotionInstruction]) -> dict[str, MotionInstruction]:
    """Moves that are known; a routine of the program's own goes before a built-in one of its name."""
    routines = {name.lower() for data in contents for name in re.findall(rb"(?i)\bPROC[ \t]+(\w+)", data)}
    built_in = {name: move for name, move in MOTIONS.items() if name.encode() not in routines}
    return {**built_in, **taught}


def task_of(path: Path) -> str:
    """Folder of the task that a module of a backup belongs to, ``RAPID/TASK1``; empty elsewhere."""
    folders = [word.upper() for word in path.parts]
    k = folders.index("RAPID") if "RAPID" in folders else len(folders)
    return "/".join(path.parts[: k + 2]) if k < len(folders) - 2 else ""


def _of_task(arm: Arm, modules: Sequence[Literals], setup: ControllerSetup) -> list[Module]:
    """The modules of a task."""
    task = Task(modules, setup)
    every = [Uses(module, task) for module in modules]
    for uses in every:
        uses.gather()
    return [uses.module(arm) for uses in every]


ENCODINGS = ("utf-8",)


def _listing(data: bytes, source: str) -> Listing:
    return Listing([(source, data)], "RAPID", ENCODINGS)


def parse(arm: Arm, data: bytes, source: str, setup: ControllerSetup) -> Module:
    """Read a RAPID module by itself."""
    return _of_task(arm, [Literals(_listing(data, source), _instructions([data], {}))], setup)[0]


def comments_of(listing: Listing) -> list[str]:
    """Comments among which the mark of a module may be."""
    reader = Reader(listing, MOTIONS)
    reader.header()
    return reader.marks


def _notes(reader: Reader) -> tuple[Note, ...]:
    """What the corrections do not know about."""
    noted: dict[str, Note] = {}
    for mention in reader.mentions:
        if mention.name in _NOTES:
            noted.setdefault(mention.name, Note(reader.line(mention.start), _NOTES[mention.name]))
    return tuple(sorted(noted.values(), key=lambda note: note.line))


SPEED_NAMES = (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000)
"""Speeds that RAPID has names for, mm/s."""


def write_moves(moves: Moves) -> dict[str, str]:
    """``plan.mod``: absolute joint moves to fine points."""
    mm_s = round(moves.tip_speed / MM)
    speed = f"v{mm_s}" if mm_s in SPEED_NAMES else f"[{mm_s},500,5000,1000]"
    absent = ",".join(["9E9"] * 6)
    lines = ["MODULE irbcal_plan", *(f"  ! {note(text)}" for text in moves.head), "  PROC main()", "    AccSet 50,50;"]
    for move, joints in zip(moves.moves, moves.texts(), strict=True):
        lines += [f"    ! {note(move.comment)}"] if move.comment else []
        lines.append(f"    MoveAbsJ [[{','.join(joints)}],[{absent}]]\\NoEOffs,{speed},fine,tool0;")
        lines += [f"    WaitTime {move.wait_s:g};"] if move.wait_s else []
    return {"plan.mod": "\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])}


_CFG_TYPE = re.compile(r"^([A-Z][A-Z0-9_]*):[ \t]*\r?$", re.M)
_CFG_VALUE = re.compile(r"-([A-Za-z]\w*)(?:[ \t]+(\"[^\"\r\n]*\"|[-+]?[\d.][\w.+-]*|[A-Za-z]\w*))?")


def backup(files: Sequence[Path]) -> Backup:
    """The base frame in ``MOC.cfg``, and whether the robot has a calibration there."""
    out = Backup()
    for root in folders_named(files, "rapid"):
        for path in [file for folder in files_named(root.parent, "syspar") for file in files_named(folder, "moc.cfg")]:
            for robot in _instances(text_of(path), "ROBOT"):
                calibration = robot.get("use_robot_calib", "")
                if calibration and "uncalib" not in calibration.lower():
                    words = f"the robot has a calibration of its maker (use_robot_calib {calibration} in {path.name})"
                    out = out._replace(accuracy=words)
                numbers = [robot.get(f"base_frame_pos_{axis}", "0") for axis in "xyz"]
                numbers += [robot.get(f"base_frame_orient_u{k}", "1" if k == 0 else "0") for k in range(4)]
                try:
                    values = np.array([float(number) for number in numbers])
                except ValueError:
                    raise ProgramError(f"the base frame of {robot.get('name')} is not in numbers", file=path) from None
                if problem := notation.Quaternion().problem(values[3:].tolist()):
                    raise ProgramError(f"base frame of {robot.get('name', 'a robot')}: {problem}", file=path)
                T = notation.poses_from_numbers(np.concatenate([values[:3] / MM, values[3:]])[None])[0]
                out = placed(out, T, path)
    return out


def _instances(text: str, kind: str) -> list[dict[str, str]]:
    """Instances of one type of a configuration file of ABB, their attributes without quotes."""
    types = list(_CFG_TYPE.finditer(text))
    out: list[dict[str, str]] = []
    for found, end in up_to_next(types, len(text)):
        if found[1] == kind:
            for name, value in _CFG_VALUE.findall(text, found.end(), end):
                out += [{}] if name == "name" or not out else []
                out[-1][name] = value.strip('"')
    return out


_POSE = "[[{0},{1},{2}],[{3},{4},{5},{6}]]"
LANGUAGE = Language(
    name="RAPID",
    endings=(".mod", ".prg", ".sys", ".modx", ".sysx"),
    looks_like=looks_like,
    reader=read_for,
    fingerprint=mark_among(comments_of, "RAPID", ENCODINGS),
    maker=ABB,
    robots=r"(^|_)(abb|irb_?\d)",
    write_moves=write_moves,
    motions=MOTIONS,
    moves_name_tools=True,
    backup=backup,
    declaration=FrameDeclaration(
        *ANY_WORD,
        head="MODULE irbcal_cell\n  ! The loads of tools are not known here: set them in place of mass -1",
        tool=f"  PERS tooldata {{name}}:=[TRUE,{_POSE},[-1,[0,0,0],[1,0,0,0],0,0,0]];",
        work_object=f'  PERS wobjdata {{name}}:=[FALSE,TRUE,"",{_POSE},[[0,0,0],[1,0,0,0]]];',
        foot="ENDMODULE",
        held_part=f'  PERS wobjdata {{name}}:=[TRUE,TRUE,"",{_POSE},[[0,0,0],[1,0,0,0]]];',
        fixed_tool=f"  PERS tooldata {{name}}:=[FALSE,{_POSE},[-1,[0,0,0],[1,0,0,0],0,0,0]];",
    ),
    sample=SampleArm(
        folder="abb",
        stops=((10, -10, 20, 15, 40, -30), (-20, 15, 5, -30, 35, 60), (35, 25, -30, 10, 50, -80)),
        tool=(0, 0, 150, 1, 0, 0, 0),
        frame=(800, 0, 400, 1, 0, 0, 0),
        tried={"job.mod": "--out job_calibrated.mod", "backup": "--out abb-job"},
        robot_name="irb1600",
    ),
)
