"""The gains of the 2014 observer judged before it drives: stability, observability, noise against lag."""
