@echo off
rem A double click starts the app in a browser; the window stays where that went wrong.
setlocal
set "PYTHON_HERE=python"
py -3 --version >nul 2>nul && set "PYTHON_HERE=py -3"
%PYTHON_HERE% "%~dp0app.py" %*
if errorlevel 1 pause
