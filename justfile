# Short names for plain commands; the commands themselves are in README.md and CONTRIBUTING.md. `just` is never needed.

# style, types, floors
check:
    ruff format --check .
    ruff check .
    pyright
    lint-imports

# everything: style, types, floors, tests
test:
    pytest

# put the house style on
format:
    ruff format .
    ruff check --fix .
