"""The pages over `heronry top` from which an order is given.

    panels ──o──► Choice ──enter──► (Number of a priority, or Script) ──► Question ──y──► manager, or demo ──► answer
                  escape            escape                                n, escape       in a thread, for seconds

A page keeps the orders of the moment when it was opened. The manager or the demo decides, and answers an order that is
no longer possible with a sentence.
"""

from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Footer, Input, OptionList, Static, TextArea
from textual.widgets.option_list import Option

from heronry_tools.watch.offered_orders import ORDERS
from heronry_tools.watch.top.orders import Order
from heronry_wire.management import MOST_PRIORITY

_COST = (
    "'heronry plan' with --down, --phase or --priority shows beforehand what would run then, and what would be lost."
)
_COST_OF_A_SCRIPT = "'heronry pcs apply' without --live shows beforehand what the script makes of a plan."


class Choice(ModalScreen[Order | None]):
    """The orders that can be given now; Enter chooses one, typed letters leave those that have them."""

    BINDINGS: ClassVar[list[BindingType]] = [
        ("escape", "leave", "leave it"),
        ("down", "step(1)"),
        ("up", "step(-1)"),
        ("pagedown", "step(10)"),
        ("pageup", "step(-10)"),
    ]

    def __init__(self, orders: list[Order]) -> None:
        super().__init__()
        self._orders, self._shown = orders, orders

    def compose(self) -> ComposeResult:
        """Yield the field for letters, the list, and the footer."""
        yield Static(Text("An order: up and down choose, letters shorten the list, Enter goes on", "bold"))
        yield Input(placeholder="letters of an order", id="letters")
        yield OptionList(id="orders")
        yield Footer()

    def on_mount(self) -> None:
        """List all orders."""
        self._list("")
        self.query_one("#letters").focus()

    def on_input_changed(self, said: Input.Changed) -> None:
        """List the orders with the letters that were typed."""
        self._list(said.value.strip().lower())

    def on_input_submitted(self, said: Input.Submitted) -> None:
        """Choose the order that is marked."""
        said.stop()  # the panels would take it for their filter
        at = self.query_one(OptionList).highlighted
        if at is not None:
            self.dismiss(self._shown[at])

    def on_option_list_option_selected(self, picked: OptionList.OptionSelected) -> None:
        """Choose an order that was clicked."""
        self.dismiss(self._shown[picked.option_index])

    def action_step(self, by: int) -> None:
        """Mark another order, `by` lines below."""
        orders = self.query_one(OptionList)
        if self._shown:
            orders.highlighted = min(max((orders.highlighted or 0) + by, 0), len(self._shown) - 1)

    def action_leave(self) -> None:
        """Give no order."""
        self.dismiss(None)

    def _list(self, letters: str) -> None:
        self._shown = [order for order in self._orders if letters in order.word().lower()]
        orders = self.query_one(OptionList)
        orders.clear_options()
        orders.add_options(
            [Option(Text(order.word(), "red" if ORDERS[order.do].is_grave else "")) for order in self._shown]
        )
        orders.highlighted = 0 if self._shown else None


class Number(ModalScreen[Order | None]):
    """Asks for the priority of a function."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape", "leave", "leave it")]

    def __init__(self, order: Order, now: int) -> None:
        super().__init__()
        self._order, self._now = order, now

    def compose(self) -> ComposeResult:
        """Yield the field, and what may be written in it."""
        yield Static(
            Text(f"The priority of {self._order.what}, now {self._now}: 0 (not wanted) to {MOST_PRIORITY}, or default")
        )
        yield Input(id="priority")
        yield Static(id="wrong")
        yield Footer()

    def on_mount(self) -> None:
        """Wait for what is typed."""
        self.query_one("#priority").focus()

    def on_input_submitted(self, said: Input.Submitted) -> None:
        """Take the number, or say what is wrong with it."""
        said.stop()  # as above
        text = said.value.strip()
        if text == "default":
            self.dismiss(Order("priority", self._order.what))
        elif text.isascii() and text.isdecimal() and int(text) <= MOST_PRIORITY:
            self.dismiss(Order("priority", self._order.what, int(text)))
        else:
            self.query_one("#wrong", Static).update(
                Text(f"{text or 'nothing'} is no priority: write 0 to {MOST_PRIORITY}, or default", "bold red")
            )

    def action_leave(self) -> None:
        """Give no order."""
        self.dismiss(None)


class Script(ModalScreen[Order | None]):
    """Asks for the text of a script."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "leave", "leave it", priority=True),
        Binding("ctrl+s", "take", "go on", priority=True),
    ]

    def compose(self) -> ComposeResult:
        """Yield the field, and what may be written in it."""
        yield Static(
            Text("A script: statements on modules and their wires, as of 'heronry pcs apply', typed or pasted here")
        )
        yield TextArea(id="script")
        yield Static(id="wrong")
        yield Footer()

    def on_mount(self) -> None:
        """Wait for what is typed."""
        self.query_one("#script").focus()

    def action_take(self) -> None:
        """Take the text, if there is any."""
        text = self.query_one("#script", TextArea).text
        if text.strip():
            self.dismiss(Order("script", text))
        else:
            self.query_one("#wrong", Static).update(Text("there is no statement yet", "bold red"))

    def action_leave(self) -> None:
        """Give no order."""
        self.dismiss(None)


class Question(ModalScreen[bool]):
    """Asks whether an order shall be given."""

    BINDINGS: ClassVar[list[BindingType]] = [
        ("y", "answer(True)", "give it"),
        ("n,escape,q", "answer(False)", "leave it"),
    ]

    def __init__(self, order: Order) -> None:
        super().__init__()
        self._order = order

    def compose(self) -> ComposeResult:
        """Yield the question, what is known of the cost, and the footer."""
        words = ORDERS[self._order.do]
        is_script = self._order.do == "script"
        cost = words.cost or (_COST_OF_A_SCRIPT if is_script else _COST)
        with VerticalScroll(id="page"):
            yield Static(Text(self._order.question(), "bold red" if words.is_grave else "bold"))
            yield Static(Text(f"\n{cost}\n\ny gives the order, n leaves it."))
            yield Static(Text(f"\n{self._order.what}" if is_script else ""))
        yield Footer()

    def action_answer(self, answer: bool) -> None:
        """Answer the question."""
        self.dismiss(answer)
