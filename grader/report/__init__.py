"""Words and layout of a result: pages, exports, terminal. No arithmetic. Imports the evidence and the cohort."""
