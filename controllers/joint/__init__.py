"""The joint as a position controller sees it: its model, the schedule of models, its estimate."""
