"""How good the results are: synthetic recordings, evaluation, annotation of ground truth."""
