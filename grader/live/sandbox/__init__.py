"""The sandbox of a session and its student's processes, made by `confine`; imports no other folder of the live half."""
