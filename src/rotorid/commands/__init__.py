"""What each command does, a module each with one function `run`; and the exit codes."""

OK = 0  # done
# Not identifiable, not converged, a validation that fails; or the answer stands, but its report
# could not be made.
NO_ANSWER = 1
WRONG_INPUT = 2  # wrong usage or unreadable input: one line, nothing written
REJECTED = 3  # an answer that the data reject; with --strict what is not plainly ok, too
# As a shell has it for SIGINT. Where identify has an answer by then, that of its status.
INTERRUPTED = 130
BROKEN_PIPE = 141  # and for SIGPIPE
SIGNALLED = 128  # plus the number of any other signal
