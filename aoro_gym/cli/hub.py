"""Commands that share policies on the Hugging Face Hub."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from aoro_gym.cli import options
from aoro_gym.cli.application import Application
from aoro_gym.cli.options import argument, option
from aoro_gym.cli.outcome import checking_input, conclude
from aoro_gym.reporting import terminal

app = Application(no_args_is_help=True, rich_markup_mode="rich", help="Policies on the Hugging Face Hub.")

PolicyArgument = Annotated[Path, argument("FILE", "Policy (.json with its .safetensors).")]
PlaceArgument = Annotated[str, argument("REPO|FOLDER", "OWNER/NAME on the Hub, or a folder such as ./shared.")]
PrivateOption = Annotated[bool, option("--private", None, "Of a repository that is made.")]
OutOption = Annotated[Path, option("--out -o", "FOLDER", "Folder to write to.")]


@app.callback()
def _shared() -> None:
    """Policies on the Hugging Face Hub."""


@app.command()
def push(
    policy: PolicyArgument,
    place: PlaceArgument,
    private: PrivateOption = False,
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Upload a learned policy with a model card: what it observes, how it was trained, how well it does.

    The card's figures are those of the evaluation that 'aoro-gym train' left beside the policy. A FOLDER gets what the
    Hub would get. Needs pip install 'aoro-gym\\[hub]' and, once, 'hf auth login'; a FOLDER needs neither.

    [bold]Examples[/]

      aoro-gym hub push runs/turning/best.json ./shared
      aoro-gym hub push runs/turning/best.json OWNER/aoro-turning --private
    """
    with checking_input(), terminal.progress("uploading"):
        from aoro_gym.agents.policies import hub

        address = hub.push(policy, place, private=private)
    conclude({"address": address}, [f"pushed to {address}"], json_to=json_to, highlight=False, markup=False)


@app.command()
def pull(
    place: PlaceArgument,
    out: OutOption = Path("pulled"),
    json_to: options.JsonOption = None,
    quiet: options.QuietOption = False,
) -> None:
    """Fetch a policy that was pushed, and read it: it is numbers and runs no code of its maker.

    Writes FOLDER/policy.json with its numbers and README.md, the card.

    [bold]Examples[/]

      aoro-gym hub pull ./shared --out pulled
      aoro-gym evaluate --env AORO/Turning-v0 --policy pulled/policy.json
    """
    with checking_input(), terminal.progress("fetching"):
        from aoro_gym.agents.policies import hub

        file = hub.pull(place, out)
    conclude({"policy": str(file)}, written=[file], json_to=json_to)
