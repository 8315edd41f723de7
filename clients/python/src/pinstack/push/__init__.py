"""The commands ``push`` and ``watch``, which send the folders of a capture PC and fetch the results, and ``convert``.

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
| ``raws``, ``exif``, ``tiff`` | camera raw files, and the pictures that are made from them |
| ``converter``, ``spool`` | converts several at once; keeps what is converted until it is sent |
| ``convert`` | the command of the same name |
| ``settings`` | command line, environment and the file of a rig |
| ``cli`` | the commands |
"""
