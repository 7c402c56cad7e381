"""Networks that plan, trained on their own corrected plans: without demonstrations or rewards."""
