"""The methods, one file each; `alignment.ESTIMATORS` is their list."""
