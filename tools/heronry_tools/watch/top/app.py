"""`heronry top` in a terminal, with Textual: panels of text, painted anew at most twice a second.

Events are taken from the feed as they come, even while the picture is frozen. A panel is painted only where its text
has changed, so that little is sent over a slow line (SSH).
"""

import asyncio
import os
from typing import Any, ClassVar

from rich.text import Text
from textual import work
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.geometry import Region
from textual.screen import ModalScreen
from textual.widgets import Footer, Input, Static

from heronry_tools.watch.snapshot import Snapshot
from heronry_tools.watch.top import panels
from heronry_tools.watch.top.order_pages import Choice, Number, Question, Script
from heronry_tools.watch.top.panels import Look, joined
from heronry_tools.watch.top.sources import RecordedSource, TopSource
from heronry_tools.watch.top.terminal import Terminal

REPAINT_S = 0.5
_STANDARD_INPUT = 0
_LOOK_S = 0.1  # the longest time for which a feed is not looked at
_STEP_NS = 1_000_000_000
_MOST_EVENTS = 200
_ANSWER_S = 20.0  # for which the answer to an order is shown
_WIDE, _HIGH = 140, 36
_FOOTER, _LEAST_BELOW = 1, 5  # lines
_TABS = ("events", "reconfigurations", "modules")
_HELP = """\
up, down       select a PE                    d   all details of it, and of the last reconfiguration
1, 2, 3        events, reconfigurations, modules of the selected PE (tab: the next one)
/              show only lines with these words; empty: all       SPACE   freeze the picture; counting goes on
?              this page                      q   quit
o              give an order to the manager, or to the demo, after a question
page up, page down   scroll the functions

of a recording:  left, right   one second     [, ]   the reconfiguration before, the next one
                 p   play at 1x, 4x, 16x      home, end   to its start, to its end
"""


_OWN_ACTIONS = frozenset(
    {
        "help",
        "filter",
        "freeze",
        "details",
        "tab",
        "play",
        "reconfiguration",
        "quit",
        "select",
        "show",
        "move",
        "end",
        "functions",
        "order",
    }
)


def _shown(key: str, action: str, words: str | None = None) -> Binding:
    """Return a binding of a key to an action, which no widget can take away and which the footer shows.

    words: the label of the key in the footer; None: the name of the action.
    """
    return Binding(key, action, action if words is None else words, priority=True)


def _quiet(key: str, action: str) -> Binding:
    return Binding(key, action, show=False, priority=True)


class Reading(ModalScreen[None]):
    """A page of text over the panels; each of the keys Escape, q, d and ? closes it."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,q,d,question_mark", "close", "close")]

    def __init__(self, text: str) -> None:
        super().__init__()
        self._text = text

    def compose(self) -> ComposeResult:
        """Yield the text, which scrolls, and the footer."""
        with VerticalScroll(id="page"):
            yield Static(Text(self._text))
        yield Footer()

    def action_close(self) -> None:
        """Close the page."""
        self.dismiss()


class TopApp(App[None]):
    """The panels of `heronry top`, for one live feed or one recording."""

    CSS_PATH = "app.tcss"
    ENABLE_COMMAND_PALETTE = False
    AUTO_FOCUS = None
    BINDINGS: ClassVar[list[BindingType]] = [
        _shown("question_mark", "help"),
        _shown("slash", "filter"),
        _shown("space", "freeze"),
        _shown("d", "details"),
        _shown("o", "order"),
        _shown("tab", "tab", "panel"),
        _shown("q", "quit"),
        _shown("p", "play"),
        Binding("left_square_bracket", "reconfiguration(0)", "step", key_display="[ ]", priority=True),
        _quiet("right_square_bracket", "reconfiguration(1)"),
        _quiet("up", "select(-1)"),
        _quiet("down", "select(1)"),
        _quiet("pageup", "functions(-1)"),
        _quiet("pagedown", "functions(1)"),
        *(_quiet(str(number), f"show({number - 1})") for number in range(1, len(_TABS) + 1)),
        _quiet("left", "move(-1)"),
        _quiet("right", "move(1)"),
        _quiet("home", "end(0)"),
        _quiet("end", "end(1)"),
    ]
    _OF_A_RECORDING: ClassVar[frozenset[str]] = frozenset({"play", "reconfiguration", "move", "end"})

    def __init__(self, source: TopSource) -> None:
        """Show a source; the caller closes it."""
        super().__init__(driver_class=Terminal)
        self.source = source
        self.look = Look()
        self.repaints = 0
        self._tab = 0
        self._frozen: Snapshot | None = None
        self._waits_on: set[int] = set()
        self._answer = ""  # to the last order
        self._is_asked = False  # there is none yet

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Tell whether the action of a key can be carried out now.

        While a page or the filter is open, the keys of the panels have no effect. Otherwise, the keys for a recording
        have an effect only if the source is a recording, and orders can be given if it is a manager.
        """
        del parameters
        if isinstance(self.screen, ModalScreen) or isinstance(self.focused, Input):
            return action not in _OWN_ACTIONS
        if action == "order":
            return self.source.operator is not None
        return self.source.is_recorded or action not in self._OF_A_RECORDING

    def compose(self) -> ComposeResult:
        """Yield the panels from top to bottom: the head, the buses, the PEs beside the functions, and the tabs.

        Below the tabs come the line for the words of a filter, and the footer.
        """
        yield Static(id="head")
        yield Static(id="buses")
        with Horizontal(id="middle"):
            with VerticalScroll(id="pes-scroll", can_focus=False):
                yield Static(id="pes")
            with VerticalScroll(id="functions-scroll", can_focus=False):
                yield Static(id="functions")
        with Horizontal(id="below"):
            for name in _TABS:
                with Vertical(id=f"{name}-box"):
                    yield Static(id=name)
        yield Input(placeholder="show only lines with these words", id="filter")
        yield Footer()

    def on_mount(self) -> None:
        """Start the timers that take events and paint, and paint for the first time."""
        self.query_one("#filter").display = False
        self.set_interval(_LOOK_S, self._take)
        self.set_interval(REPAINT_S, self.paint)
        self._take()
        self._arrange()
        self.paint()

    def on_resize(self) -> None:
        """Show all lower panels side by side if there is room; if there is not, show one of them."""
        self._arrange()
        self.call_after_refresh(self.paint)

    def snapshot(self) -> Snapshot:
        """Return the snapshot that is shown: the present one, or the frozen one."""
        return self.source.snapshot() if self._frozen is None else self._frozen

    def _take(self) -> None:
        """Take the events that have come, and wait for more on the descriptors that the source now has.

        If the terminal has closed, the program ends. A closed terminal always counts as readable, so Textual would read
        it again and again without a pause.
        """
        if not (self.is_headless or os.isatty(_STANDARD_INPUT)):
            self.exit()
            return
        self.source.look()
        loop, readers = asyncio.get_running_loop(), set(map(_fileno, self.source.readers()))
        for fileno in self._waits_on - readers:
            loop.remove_reader(fileno)
        for fileno in readers - self._waits_on:
            loop.add_reader(fileno, self._take)
        self._waits_on = readers

    def _arrange(self) -> None:
        is_large = self.size.width >= _WIDE and self.size.height >= _HIGH
        self.screen.set_class(is_large, "large")
        for number, name in enumerate(_TABS):
            self.query_one(f"#{name}-box").display = is_large or number == self._tab

    def paint(self) -> None:
        """Write the panels. Do nothing if a timer calls this before the panels exist, or while the program ends."""
        if not self.query("#modules"):
            return
        view, width = self.snapshot(), self.size.width
        self.repaints += 1
        look = self.look = self._selected(view)
        first, *wrong = panels.head(view)
        self._write("head", [first, *self._notes(), *wrong])
        self._write("buses", panels.buses(view, width))
        self._write("pes", panels.pes(view, look))
        self._write("functions", [*panels.functions(view, look), *panels.plants(view, look)])
        self._write("events", panels.events(view, look, _MOST_EVENTS))
        self._write("reconfigurations", panels.reconfigurations(view, look))
        self._write("modules", panels.modules(view, look))
        self.call_after_refresh(self._fit)

    def _fit(self) -> None:
        """Give PEs and functions the room that they need, but leave some for the panels below."""
        above = sum(self.query_one(name).outer_size.height for name in ("#head", "#buses"))
        room = self.size.height - above - _FOOTER - _LEAST_BELOW
        self.query_one("#middle").styles.max_height = max(room, _LEAST_BELOW)

    def _selected(self, view: Snapshot) -> Look:
        if self.look.selected in view.pes or not view.pes:
            return self.look
        return Look(next(iter(view.pes)), self.look.words)

    def _notes(self) -> list[Text]:
        notes = [self.source.note(), self._answer]
        if self._frozen is not None:
            since = self.source.snapshot().events - self._frozen.events
            notes.append(f"FROZEN, {since} events since: SPACE goes on")
        if self.look.words:
            notes.append(f"only lines with '{self.look.words}'")
        said = "   ".join(filter(None, notes))
        return [Text(said, "bold cyan")] if said else []

    def _write(self, name: str, lines: list[Text]) -> None:
        panel = self.query_one(f"#{name}", Static)
        text = joined(lines)
        if getattr(panel, "shown_text", None) != text:
            panel.shown_text = text  # type: ignore[attr-defined]
            panel.update(text)

    # What the keys do

    def action_help(self) -> None:
        """Show the page that explains the keys, and the letters that stand beside the colours."""
        self.push_screen(Reading(_HELP + "\n" + "\n".join(panels.LEGEND)))

    def action_details(self) -> None:
        """Show a page with the details of the selected PE, the last reconfiguration and the functions not served."""
        self.push_screen(Reading("\n".join(panels.details(self.snapshot(), self.look)) or "nothing is known yet"))

    def action_freeze(self) -> None:
        """Freeze the picture, or show the present again."""
        self._frozen = self.source.snapshot() if self._frozen is None else None
        self.paint()

    def action_select(self, step: int) -> None:
        """Select the next PE (1) or the previous one (-1)."""
        names = list(self.snapshot().pes)
        if names:
            at = names.index(self.look.selected) if self.look.selected in names else 0
            self.look = Look(names[(at + step) % len(names)], self.look.words)
            self.paint()
            self._bring_selected_into_view()

    def _bring_selected_into_view(self) -> None:
        """Scroll the PEs until the selected one is seen; with reasons they may be longer than their panel."""
        panel = self.query_one("#pes-scroll", VerticalScroll)
        width, at = max(1, panel.size.width), 0
        for line in panels.pes(self.snapshot(), self.look):
            height = -(-line.cell_len // width)
            if line.plain[1:2] == ">":
                panel.scroll_to_region(Region(0, at, width, height), animate=False)
            at += height

    def action_functions(self, step: int) -> None:
        """Scroll the functions down by a page (1) or up (-1); with reasons they may be longer than their panel."""
        panel = self.query_one("#functions-scroll", VerticalScroll)
        panel.scroll_relative(y=step * panel.size.height, animate=False)

    def action_tab(self) -> None:
        """Show the next one of the lower panels."""
        self.action_show((self._tab + 1) % len(_TABS))

    def action_show(self, number: int) -> None:
        """Show a lower panel, by its number from 0."""
        self._tab = number
        self._arrange()

    def action_filter(self) -> None:
        """Open the field for the words of the filter."""
        field = self.query_one("#filter", Input)
        field.display = True
        field.focus()

    def on_input_submitted(self, said: Input.Submitted) -> None:
        """Use the words in the field as filter, and close the field."""
        self.look = Look(self.look.selected, said.value.strip())
        said.input.display = False
        self.set_focus(None)
        self.paint()

    def action_order(self) -> None:
        """Let the user give an order; while the last one is not answered, refuse."""
        if self._is_asked:
            self._tell("the last order is not answered yet; try again when it is")
        else:
            self._order()

    @work(exclusive=True)
    async def _order(self) -> None:
        """Let the user choose an order that can be given now, ask whether it shall be given, and give it."""
        operator, view = self.source.operator, self.source.snapshot()
        assert operator is not None, "the key is bound only for a manager"
        order = await self.push_screen_wait(Choice(list(operator.offered(view, self.look.selected))))
        if order is not None and order.do == "priority":
            order = await self.push_screen_wait(Number(order, view.functions[order.what].priority))
        elif order is not None and order.do == "script":
            order = await self.push_screen_wait(Script())
        if order is None or not await self.push_screen_wait(Question(order)):
            return
        self._tell(f"{order.word()}: no answer yet ...")
        self._is_asked = True
        try:
            answer = await asyncio.to_thread(operator.give, order)
        finally:
            self._is_asked = False
        self._tell(answer)

    def _tell(self, sentence: str) -> None:
        self._answer = sentence
        self.set_timer(_ANSWER_S, lambda: self._forget(sentence))
        self.paint()

    def _forget(self, sentence: str) -> None:
        if self._answer == sentence:
            self._answer = ""
            self.paint()

    def action_move(self, seconds: int) -> None:
        """Move the cursor of a recording by so many seconds, backwards if the number is negative."""
        self._recorded().move(seconds * _STEP_NS)
        self.paint()

    def action_reconfiguration(self, which: int) -> None:
        """Move the cursor to the next reconfiguration (1), or to the previous one (0)."""
        self._recorded().to_reconfiguration(is_next=bool(which))
        self.paint()

    def action_play(self) -> None:
        """Let the cursor run at the next higher speed; after the highest speed, stop the cursor."""
        self._recorded().play()

    def action_end(self, which: int) -> None:
        """Move the cursor to the start (0) or the end (1) of the recording."""
        timeline = self._recorded().timeline
        self._recorded().move_to(timeline.ends_ns if which else timeline.begins_ns)
        self.paint()

    def _recorded(self) -> RecordedSource:
        assert isinstance(self.source, RecordedSource), "these keys are bound only for a recording"
        return self.source


def _fileno(reader: Any) -> int:
    """Return the descriptor of a reader, which may be a number or an object with `fileno`."""
    return reader if isinstance(reader, int) else int(reader.fileno())


def run_top(source: TopSource) -> None:
    """Show a live feed or a recording in `heronry top` until the user quits, and then close it."""
    try:
        TopApp(source).run()
    finally:
        source.close()
