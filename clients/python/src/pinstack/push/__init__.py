"""The commands ``push`` and ``watch``: send the folders of a capture PC, and fetch the results.

| module | what it does |
|---|---|
| ``folders`` | which folders are stacks, and their slices |
| ``journal`` | what was sent, on disk: nothing is sent twice, and an upload continues after a crash |
| ``causes`` | what a refusal depends on, and so what sends a stack again |
| ``sender`` | sends one stack, waits for it and saves its results |
| ``run`` | several stacks at a time |
| ``watch`` | sends folders as they become complete, and again |
| ``gone`` | views of a scan whose folder is not there any more |
| ``names`` | names of result files |
| ``results``, ``sheet`` | files beside the stacks, and an HTML page that shows them |
| ``settings`` | command line, environment and the file of a rig |
| ``cli`` | the commands |
"""
