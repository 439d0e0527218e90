"""What a user comes for beside a run: each package is one subject, whole, and knows no other."""
