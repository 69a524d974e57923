"""How a session and its student's processes are confined. Imports no other folder of the live half."""
