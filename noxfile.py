"""What is too slow for every change, each by one command: `uvx nox -s NAME`."""

import nox

nox.options.default_venv_backend = "uv"
nox.options.sessions = []


@nox.session
def sbom(session: nox.Session) -> None:
    """dist/sbom.json (CycloneDX) and dist/licenses.md of what `pip install saccade` installs."""
    session.install(".")
    python = f"{session.virtualenv.location}/bin/python"
    session.run(
        *("uvx", "--from", "cyclonedx-bom", "cyclonedx-py", "environment", python),
        *("--pyproject", "pyproject.toml", "--output-file", "dist/sbom.json"),
        external=True,
    )
    session.run(
        *("uvx", "pip-licenses", "--python", python, "--format", "markdown", "--with-urls"),
        *("--from", "mixed", "--output-file", "dist/licenses.md"),
        external=True,
    )
