"""The paper's study, reproduced with the product's own code, and taken further.

Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for robotic
mapping", DSCC 2018-9140.
"""
