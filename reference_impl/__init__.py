"""Reference implementation of Zhuang & Wang (2014)."""
