"""The paper's experiment (Section V) and more: every method in one tracking framework, from one command.

clips -> reference -> tuning -> matching and tracking -> tables -> figures -> page; ``run`` is the order of the work.
"""
