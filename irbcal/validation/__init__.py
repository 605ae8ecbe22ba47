"""Validation: is it true?"""
