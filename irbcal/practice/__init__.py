"""What can I try each command with? Small example files, all SIMULATED.

One file a kind of example: ``measured`` (what a tracker measured), ``foreign`` (the same as other programs write it),
``checks`` (ISO 9283, tracker, ballbar, controller), ``rail``, ``makers`` (arms and programs of several makers). Each
offers ``files()``, which yields `irbcal.practice.sample.Sample`; ``samples`` writes them all.
"""
