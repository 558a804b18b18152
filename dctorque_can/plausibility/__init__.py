"""Slow checks of what must hold over minutes: does the vehicle file fit the car?"""
