"""Linear model-predictive control: on a whole linear model at one point, or along planned moves."""
