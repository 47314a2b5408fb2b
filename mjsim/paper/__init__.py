"""The paper reproduced: figures 3 to 17 of Kato, Tsutsumi and Sato, IJMTM 64 (2013) 1-11, and its printed numbers
beside simulated ones.
"""
