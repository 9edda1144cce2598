"""The checks of `heronry preflight`: what a manager tells, what is heard on its buses, and what `doctor` checks."""
