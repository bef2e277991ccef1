"""The net of golden results: what every command says today, held against what it says later.

`python -m golden compare` (`make golden`) runs every case of `golden.cases` by the command line and
compares exit codes, texts, JSON and written files with `golden/results.json.xz`;
`python -m golden record` (`make golden-record`) writes that file anew.
"""
