"""The frozen benchmark set: how version 1 was made from scenes and truths."""
