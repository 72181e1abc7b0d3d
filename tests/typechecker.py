"""beartype as the tests use it: a whole number may stand where a float is asked for (PEP 484)."""

from beartype import BeartypeConf, beartype

# Functions and classes, not assignments. Exporters are files that run in other programs, too.
SKIPPED = ("data_recipes.exporters",)
CONF = BeartypeConf(is_pep484_tower=True, claw_is_pep526=False, claw_skip_package_names=SKIPPED)
check = beartype(conf=CONF)
