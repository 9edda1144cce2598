"""What holds for all tests: an example may take as long as it takes; how fast code is, benchmarks say."""

from hypothesis import settings

settings.register_profile("untimed", settings.default, deadline=None)
settings.load_profile("untimed")
