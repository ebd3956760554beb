"""A benchmark of diagnoses: cases, answers, baselines and one table."""
